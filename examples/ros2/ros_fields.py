"""Messages of rclpy as dictionaries, as hpop takes and gives them; the nodes beside this file share it."""

from __future__ import annotations

import re
from importlib import import_module
from typing import Any


def type_of(kind: str) -> Any:
    """Return the class of a type such as nav_msgs/msg/Path, or nav_msgs/Path as fields name it."""
    package, *part, name = kind.split("/")
    return getattr(import_module(f"{package}.{part[0] if part else 'msg'}"), name)


def fields_of(message: Any) -> Any:
    """Return a message as dictionaries and lists; arrays of numbers stay as they are."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: fields_of(getattr(message, name)) for name in message.get_fields_and_field_types()}
    return [fields_of(each) for each in message] if isinstance(message, list | tuple) else message


def filled(message: Any, fields: dict[str, Any]) -> Any:
    """Fill the fields of a message from dictionaries and lists, and return it; fields that it lacks are left out."""
    for name, kind in message.get_fields_and_field_types().items():
        if name not in fields:
            continue
        value, before = fields[name], getattr(message, name)
        several = re.fullmatch(r"sequence<(\w+/\w+)(?:, \d+)?>", kind)
        if several:
            value = [filled(type_of(several[1])(), each) for each in value]
        elif hasattr(before, "get_fields_and_field_types"):
            value = filled(before, value)
        elif isinstance(before, float):
            value = float(value)
        setattr(message, name, value)
    return message
