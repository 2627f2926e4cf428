"""Threads of linear algebra while programs are solved."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROGRAM = """
import ctypes, os, casadi
from hpop.planners.programs.nlp import OPENBLAS, ipopt
x = casadi.MX.sym("x")
ipopt("parabola", {"x": x, "f": (x - 1) ** 2}, {"print_time": False, "ipopt.print_level": 0})
try:
    print(ctypes.CDLL(OPENBLAS, mode=os.RTLD_NOLOAD | os.RTLD_LAZY).openblas_get_num_threads())
except OSError:
    print("none")
"""


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="with one processor, OpenBLAS has one thread by itself")
def test_the_linear_algebra_of_a_solver_uses_one_thread() -> None:
    """Matrices of these programs are small: with two threads, one waited busily and the solves took twice as long."""
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True)
    if done.stdout.strip() == "none":
        pytest.skip("this wheel of CasADi has no OpenBLAS of its own")
    assert done.stdout.strip() == "1"


SPLINES = """
import ctypes, numpy.linalg._umath_linalg as linalg
from hpop.runtime.limits import GET_THREADS, one_numpy_thread
threads = getattr(ctypes.CDLL(linalg.__file__), GET_THREADS, None)
before = threads and threads()
with one_numpy_thread():
    with one_numpy_thread():
        pass
    print(threads and threads())
print("as before" if threads and threads() == before > 1 else "none")
"""


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="with one processor, OpenBLAS has one thread by itself")
def test_splines_leave_one_thread_to_numpy_and_give_the_others_back() -> None:
    """With two threads, the eigenvalues of 13 matrices of 29 rows took 200 ms on a busy machine, with one 1 ms."""
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", SPLINES], env=environment, capture_output=True, text=True, check=True)
    if done.stdout.endswith("none\n"):
        pytest.skip("this wheel of NumPy has no OpenBLAS of its own")
    assert done.stdout.splitlines() == ["1", "as before"]
