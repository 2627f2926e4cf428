"""Names: unique, suggested when mistyped, and found in installed packages by their entry points."""

import importlib
import subprocess
import sys

import pytest

from hpop.base.registry import Registry, criteria, make_model, models, planners
from hpop.criteria import Turns
from hpop.errors import CriterionError, HpopError, ModelError, OptionError, UnknownName

PLUGIN = """
class Glare:
    pass
class Dazzle:
    pass
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that installs a tiny distribution with entry points."""

    def install(name, entry_points, source=PLUGIN):
        (tmp_path / f"{name}.py").write_text(source)
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(entry_points)
        monkeypatch.syspath_prepend(tmp_path)
        importlib.invalidate_caches()

    yield install
    for name in [n for n in sys.modules if n.startswith("hpop_test_plugin")]:
        del sys.modules[name]


def registry(group="hpop.test"):
    return Registry("criterion", "hpop.errors", group, CriterionError)


def test_what_comes_with_hpop_is_found_by_name():
    assert criteria["turns"] is Turns
    assert {"clearance", "duration", "exposure", "length", "obstruction", "rotation", "turns"} <= set(criteria)
    assert "lattice" in planners
    assert "differential_drive" in models
    assert list(criteria) == sorted(criteria)
    assert len(criteria) == len(list(criteria))


@pytest.mark.parametrize(
    ("names", "wrong", "right", "more"),
    [
        (criteria, "turn", "turns", r"For one of your own, import .* `hpop criteria` lists all \d+$"),
        (planners, "latice", "lattice", "Known: .*lattice, .* For one of your own, import "),
    ],
)
def test_an_unknown_name_says_how_the_known_ones_are_listed_and_suggests_the_nearest(names, wrong, right, more):
    with pytest.raises(UnknownName, match=rf"unknown {names.kind} '{wrong}'\. Did you mean '{right}'\? {more}"):
        names[wrong]
    assert wrong not in names


def fresh(code):
    """Return the output of a process of its own, in which no planner is imported yet."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def test_a_planner_or_criterion_is_imported_alone_and_all_of_them_when_they_are_listed():
    """A name of hpop is taken before its module is imported."""
    code = """
import sys
from hpop.errors import OptionError
from hpop.base.registry import criteria, planners
class Mine: ...
print(planners["weighted-sum"].__name__, "hpop.planners.programs.smoothing" in sys.modules)
print(criteria["o_space"].__name__, "hpop.criteria.performance.orientation" in sys.modules)
try:
    planners.add("smoothing", Mine)
except OptionError as error:
    print("taken" in str(error))
print(*planners, *criteria)
"""
    name, others, criterion, more, taken, *known = fresh(code)
    assert taken == "True"
    assert (name, others, criterion, more) == ("WeightedSum", "False", "OSpace", "False")
    assert {"any-angle", "lattice", "rrt", "smoothing", "weighted-sum-corridor", "energy", "turns"} <= set(known)


@pytest.mark.parametrize("known", [criteria, planners, models])
def test_what_comes_with_hpop_is_called_as_its_class_is(known):
    """Lazy imports find a class by its name, after which the word for its kind may follow, as in LookAtCriterion."""
    for name, cls in known.items():
        if cls.__module__.startswith("hpop."):
            letters = name.replace("-", "").replace("_", "")
            assert cls.__name__.lower() in (letters, f"{letters}{known.kind}")


def test_a_name_that_another_type_has_is_refused_and_the_first_one_stays():
    names = registry()
    first, second = type("First", (), {}), type("Second", (), {})
    names.add("glare", first)
    with pytest.raises(CriterionError, match=r"'glare' is taken by .*First; choose another name for .*Second"):
        names.add("glare", second)
    assert names["glare"] is first


@pytest.mark.parametrize(
    ("names", "error"), [(criteria, CriterionError), (planners, OptionError), (models, ModelError)]
)
def test_a_taken_name_is_an_error_of_its_kind(names, error):
    taken = next(iter(names))
    with pytest.raises(error, match=f"{names.kind} name '{taken}' is taken"):
        names.add(taken, type("Impostor", (), {}))


def test_the_same_class_may_be_defined_again_as_in_a_notebook():
    names = registry()
    names.add("glare", type("Glare", (), {}))
    again = type("Glare", (), {})
    names.add("glare", again)
    assert names["glare"] is again


def test_an_entry_point_of_an_installed_package_is_found(install):
    install("hpop_test_plugin", "[hpop.test]\nglare = hpop_test_plugin:Glare\ndazzle = hpop_test_plugin:Dazzle\n")
    names = registry()
    assert names["glare"].__name__ == "Glare"
    assert sorted(names) == ["dazzle", "glare"]
    assert "glare" not in registry("hpop.other")


def test_entry_points_are_loaded_on_first_use_only(install):
    install("hpop_test_plugin", "[hpop.test]\nglare = hpop_test_plugin:Glare\n")
    names = registry()
    assert "hpop_test_plugin" not in sys.modules
    assert "glare" in names
    assert "hpop_test_plugin" in sys.modules


def test_an_entry_point_with_a_taken_name_is_refused(install):
    install("hpop_test_plugin", "[hpop.test]\nglare = hpop_test_plugin:Glare\n")
    names = registry()
    names.add("glare", Turns)
    with pytest.raises(CriterionError, match="taken"):
        len(names)


@pytest.mark.parametrize("target", ["hpop_test_plugin:Missing", "hpop_test_plugin_that_is_not_there:Glare"])
def test_a_broken_package_is_named_every_time_and_hides_nothing(install, target):
    install("hpop_test_plugin", f"[hpop.test]\nbroken = {target}\nglare = hpop_test_plugin:Glare\n")
    names = registry()
    for _ in range(2):
        with pytest.raises(HpopError, match=rf"criterion 'broken'.*{target}.*cannot be loaded"):
            names["glare"]


def test_a_model_is_made_of_its_name_and_parameters():
    assert make_model({"differential_drive": {"radius": 0.2}}).radius == 0.2
    assert make_model({"differential_drive": None}).radius == make_model("differential_drive").radius == 0.3


@pytest.mark.parametrize(
    ("spec", "error", "message"),
    [
        ({}, ModelError, "one name"),
        ({"differential_drive": {}, "arm": {}}, ModelError, "one name"),
        (None, ModelError, "one name"),
        ({"differential_drive": [1]}, ModelError, "parameters"),
        ({"differential_drive": {"wings": 2}}, ModelError, "no parameter 'wings'. It has radius"),
        ({"differential_drive": {"raduis": 2}}, ModelError, "no parameter 'raduis'. Did you mean 'radius'. It has"),
        ({"diferential_drive": {}}, UnknownName, "Did you mean 'differential_drive'"),
    ],
)
def test_what_describes_no_model_is_refused(spec, error, message):
    with pytest.raises(error, match=message):
        make_model(spec)
