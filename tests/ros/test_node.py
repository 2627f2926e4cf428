"""The example node for rclpy, which cannot run here: it parses, says so, and uses hpop as it is."""

from __future__ import annotations

import ast
import pkgutil
import sys
from dataclasses import fields
from inspect import signature
from pathlib import Path

from hpop.ros import GoalPlanner, Interface, PlanarPose

NODE = Path(__file__).resolve().parents[2] / "examples/ros2/hpop_planner.py"
TREE = ast.parse(NODE.read_text())
ROS = {"nav2_msgs", "rclpy", "rosidl_runtime_py", "std_msgs", "tf2_ros"}


def calls(name: str) -> list[ast.Call]:
    """Return the calls of a function or a method of this name."""
    found = [node for node in ast.walk(TREE) if isinstance(node, ast.Call)]
    return [one for one in found if getattr(one.func, "id", getattr(one.func, "attr", "")) == name]


def test_it_says_that_it_is_untested() -> None:
    assert "UNTESTED" in (ast.get_docstring(TREE) or "").splitlines()[0]


def test_it_imports_what_hpop_has_and_what_ros_brings() -> None:
    for node in ast.walk(TREE):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names]
            for module in modules:
                package = module.partition(".")[0]
                assert package in ROS | {"hpop"} | set(sys.stdlib_module_names), module
                for name in node.names if package == "hpop" else []:
                    assert pkgutil.resolve_name(f"{module}.{name.name}") is not None


def test_it_calls_hpop_as_it_can_be_called() -> None:
    (interface,), (answer,), (planning,) = calls("Interface"), calls("answer"), calls("GoalPlanner")
    assert {word.arg for word in interface.keywords} < {one.name for one in fields(Interface)}
    assert len(answer.args) == len(signature(GoalPlanner.answer).parameters) - 1
    assert len(planning.args) == len(signature(GoalPlanner).parameters)
    assert all(len(call.args) == len(PlanarPose._fields) for call in calls("PlanarPose"))
    read = {node.attr for node in ast.walk(TREE) if isinstance(node, ast.Attribute)}
    assert {"values", "options", "known", "rehearsed", "options_topic"} <= read
