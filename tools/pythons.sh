#!/usr/bin/env bash
# Other versions of Python: `tools/pythons.sh [VERSION ...]`, all that hpop is for by default. For each that is found on
# PATH or by pyenv: hpop's source distribution is installed into a new environment with what it needs, of the versions
# pinned and as wheels, the demo runs from a folder elsewhere, and some tests run in the unpacked distribution.
# A Python from PyPI's `uv` (`uv python install 3.14`, then `uv python find`) is found where its folder is on PATH.
set -euo pipefail
cd "$(dirname "$0")/.."
versions=("$@")
[ $# -gt 0 ] || versions=(3.11 3.12 3.13 3.14)
out=$PWD/out/pythons
rm -rf "$out"
mkdir -p "$out"

found() {  # the Python of a version, if there is one that runs
  local python
  for python in "$(command -v "python$1" || true)" "$(pyenv root 2>/dev/null || true)"/versions/"$1".*/bin/python; do
    "$python" -c "import sys; assert '%d.%d' % sys.version_info[:2] == '$1'" 2>/dev/null && echo "$python" && return
  done
  return 1
}

tried() {  # one version: PYTHON FOLDER
  "$1" -m venv "$2/venv"
  local python=$2/venv/bin/python
  "$python" -m pip install --quiet --disable-pip-version-check --only-binary :all: --no-binary hpop -c constraints.txt \
    "$source[tables]" pytest hypothesis
  (cd "$2" && venv/bin/hpop demo > demo.txt && test -s out/museum/map.png && tail -n 3 demo.txt)
  tar -xzf "$source" -C "$2" --strip-components 1 --one-top-level="$2/source"
  (cd "$2/source" && "$python" -m pytest -q -p no:cacheprovider -m "not proof" tests/frontier tests/search/test_pareto_paths.py)
}

python3 -m venv "$out/build"
"$out/build/bin/python" -m pip install --quiet --disable-pip-version-check -c constraints.txt setuptools
"$out/build/bin/python" -c "from setuptools.build_meta import build_sdist; build_sdist('$out')" > "$out/build.txt"
source=$(echo "$out"/*.tar.gz)

failed=0
for version in "${versions[@]}"; do
  if ! python=$(found "$version"); then
    echo "$version: not found"
    continue
  fi
  mkdir "$out/$version"
  # In a shell of its own: within `if` bash would go on after an error.
  status=0
  (set -e; tried "$python" "$out/$version") > "$out/$version.txt" 2>&1 & wait $! || status=$?
  echo "$version ($("$python" -V)): $([ $status = 0 ] && echo passed || echo "FAILED, see $out/$version.txt")"
  [ $status = 0 ] || failed=1
done
exit $failed
