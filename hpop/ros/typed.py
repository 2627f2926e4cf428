"""Messages as dictionaries made instances of rosbags' types, and back; any distribution's types will do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.scalars import python_value
from hpop.base.text import shown
from hpop.errors import RosError
from hpop.ros.messages import Message

KINDS = {"string": str, "bool": bool}  # of values, others are numbers


@checked_arguments
def typed(message: Mapping[str, Any], kind: str, store: Any) -> Any:
    """An instance of a type, such as "nav_msgs/msg/Path", of a rosbags type store, which serialises it.

    Raises RosError for what is no type store, for a type that the store does not have, and for a field that is
    missing, unknown, or of another type.

    >>> from rosbags.typesys import Stores, get_typestore
    >>> typed({"x": 1.0, "y": 2.0, "z": 0.0}, "geometry_msgs/msg/Point", get_typestore(Stores.ROS2_JAZZY)).y
    2.0
    """
    if not hasattr(store, "fielddefs"):
        raise RosError(f"store must be a type store of rosbags, as get_typestore makes one, got {shown(store)}")
    if kind not in store.fielddefs:
        raise RosError(f"the type store has no {shown(kind)}; give one of the distribution that has it")
    declared = dict(store.fielddefs[kind][1])
    given = message if isinstance(message, Mapping) else {}
    if set(given) != set(declared):
        raise RosError(f"{kind} has the fields {', '.join(declared) or 'none'}, got {shown(message)}")
    return store.types[kind](
        **{name: _value(given[name], of, f"{kind}.{name}", store) for name, of in declared.items()}
    )


@checked_arguments
def plain(message: Any) -> Message:
    """A message that rosbags made as dictionaries and lists, as the bridge sends it.

    >>> from rosbags.typesys import Stores, get_typestore
    >>> plain(get_typestore(Stores.ROS2_JAZZY).types["builtin_interfaces/msg/Time"](1, 2))
    {'sec': 1, 'nanosec': 2}
    """
    names = [one.name for one in fields(message) if not one.name.startswith("_")]
    return {name: _plain(getattr(message, name)) for name in names}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return plain(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _value(value: Any, declared: Any, where: str, store: Any) -> Any:
    """A value of a declared field: (kind of node, what of)."""
    node, of = declared
    if node.name == "NAME":
        return typed(value, of, store)
    if node.name in ("ARRAY", "SEQUENCE"):
        inner = of[0]
        if not isinstance(value, list | tuple | np.ndarray):
            raise RosError(f"{where} is a list, got {shown(value)}")
        made = [_value(one, inner, where, store) for one in value]
        is_number = inner[0].name == "BASE" and inner[1][0] not in KINDS
        return np.array(made, inner[1][0]) if is_number else made
    value, kind = python_value(value), KINDS.get(of[0], float if of[0].startswith("float") else int)
    if not isinstance(value, int | float if kind is float else kind) or (isinstance(value, bool) and kind is not bool):
        raise RosError(f"{where} is {of[0]}, got {shown(value)}")
    return kind(value)
