"""Wrong arguments, told at the public border by the name of the argument.

A value of a type that a signature does not know fails somewhere inside, with an AttributeError about something that the
caller never saw. :func:`checked_arguments` marks public functions and classes: once a call of theirs has failed, its
arguments are compared with the signature, and a TypeError or ValueError says which one is wrong, what was expected and
what came. A call that succeeds costs one frame, and nothing that works is refused. What hpop raises on purpose stays.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import sys
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, wraps
from importlib import import_module
from numbers import Integral, Real
from pathlib import Path
from traceback import extract_tb
from types import FunctionType, NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin

import numpy as np

from hpop.base.text import article, shown

T = TypeVar("T", bound=Callable[..., Any])

GUARDED = "_names_arguments"
"""Attribute of functions that are guarded already, and of the errors raised for them."""
OF_EXTREMES = re.compile(
    r"empty|zero-size|shape|dimension|at least one|shorter|'list'|\bnan\b|\binf|finite|out of (range|bounds)|too large|"
    r"convert|overflow|maxsize|division|sequence",
    re.IGNORECASE,
)
"""What errors say that come of values which are empty, huge, or no numbers."""
LARGEST = 2**63
"""Numbers of at least this size overflow what is computed with."""
EMPTY = "not empty"
"""What is expected in the place of an empty collection or text."""
LOOKED_AT = 20
"""Entries of a collection that are compared with a type."""
WORDS: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    str: "text",
    bytes: "bytes",
    NoneType: "None",
    type: "a class",
    np.ndarray: "an array of numbers",
}
BUILDERS = re.compile(r"of|load|read|build|fit|through|from_\w+")
"""Class methods that make an instance."""


class AnyColumn:
    """Stands for ``Column``: an array, a number or CasADi's symbols."""


class AnyArray:
    """Stands for ``ArrayLike``: an array, or nested sequences of numbers."""


WORDS |= {AnyColumn: "an array of numbers", AnyArray: "an array of numbers"}
ALIASES = {"Column": AnyColumn, "ArrayLike": AnyArray}
"""Types that are wider than what is meant by them, by the name of their alias."""


def checked_arguments(target: T) -> T:
    """Let errors of a public function, or of a class's constructor and public methods, name a wrong argument.

    >>> @checked_arguments
    ... def doubled(values: Sequence[float]) -> list[float]:
    ...     return [2 * value for value in values]
    >>> doubled(None)
    Traceback (most recent call last):
    TypeError: doubled: values must be a list (each a number), got None
    """
    if not isinstance(target, type):
        return cast(T, _guarded(target, None))
    for name in dir(target):
        if name.startswith("_") and name != "__init__":
            continue
        value = inspect.getattr_static(target, name)
        kind, function = type(value), getattr(value, "__func__", value)
        home = getattr(function, "__module__", "").partition(".")[0]
        is_own = home in ("hpop", target.__module__.partition(".")[0])  # not of a library's class
        if isinstance(function, FunctionType) and is_own and not hasattr(function, GUARDED):
            owner = next(cls for cls in target.__mro__ if name in vars(cls))
            guarded = _guarded(function, owner)
            setattr(target, name, guarded if kind is FunctionType else kind(guarded))
    return cast(T, target)


def _guarded(function: Callable[..., Any], owner: type | None) -> Callable[..., Any]:
    """Yield a function whose errors are explained by its arguments, where these are wrong."""
    if inspect.isgeneratorfunction(function):

        @wraps(function)
        def produced(*args: Any, **kwargs: Any) -> Generator[Any, Any, Any]:
            try:
                return (yield from function(*args, **kwargs))
            except Exception as error:
                _explain(function, owner, args, kwargs, error)
                raise

        setattr(produced, GUARDED, True)
        return produced

    @wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except Exception as error:
            _explain(function, owner, args, kwargs, error)
            raise

    setattr(called, GUARDED, True)
    return called


def _explain(
    function: Callable[..., Any], owner: type | None, args: Sequence[Any], kwargs: Mapping[str, Any], error: Exception
) -> None:
    """Raise an error that names the argument at fault; return where none is, or where the error itself names it."""
    if _is_deliberate(error) and not hasattr(error, GUARDED):
        return
    hints, signature = _hints(function, owner), inspect.signature(function)
    try:
        bound = signature.bind(*args, **kwargs)
    except TypeError:  # Python's own error names what lacks or is too much
        return
    given: list[tuple[str, Any]] = []
    needed = {name for name, each in signature.parameters.items() if each.default is each.empty}
    for name, value in bound.arguments.items():
        kind = signature.parameters[name].kind
        if kind is inspect.Parameter.VAR_KEYWORD:
            given += [(key, each) for key, each in value.items()]
            hints |= dict.fromkeys(value, hints.get(name, Any))
        elif kind is inspect.Parameter.VAR_POSITIONAL:
            given += [(name, each) for each in value]
        elif name not in ("self", "cls"):
            given.append((name, value))
    title = f"{owner.__name__}.{function.__name__}".removesuffix(".__init__") if owner else function.__name__
    said, ours = str(error), hasattr(error, GUARDED)
    cause = error.__cause__ if ours else error
    misfits = [(TypeError, name, value, misfit(value, hints.get(name, Any))) for name, value in given]
    extremes = [
        (ValueError, name, value, extreme(value))
        for name, value in given
        if (name in needed or isinstance(value, Real | list | np.ndarray))
        and (isinstance(error, OverflowError | MemoryError) or OF_EXTREMES.search(said))
    ]
    for raised, name, value, wrong in (*misfits, *extremes):
        if wrong == EMPTY and isinstance(error, OverflowError | MemoryError):
            continue  # what is empty neither overflows nor fills memory
        if wrong:
            if not ours and isinstance(error, TypeError | ValueError) and re.search(rf"\b{re.escape(name)}\b", said):
                return
            raise _named(raised(f"{title}: {name} must be {wrong}, got {shown(value)}")) from cause
    for name, value in given:
        if isinstance(value, str) and isinstance(error, LookupError | AttributeError) and repr(value) in said:
            raise _named(ValueError(f"{title}: there is no {name} {shown(value)}")) from cause
    numbers: list[tuple[str, Any]] = [
        (name, value) for name, value in given if isinstance(value, int | float | np.number)
    ]
    for name, value in sorted(numbers, key=lambda one: -abs(one[1])):
        if value < 0 and "negative" in said:
            raise _named(ValueError(f"{title}: {name} must not be negative, got {shown(value)}")) from cause
        if isinstance(error, IndexError):
            raise _named(ValueError(f"{title}: {name} is out of range, got {shown(value)}")) from cause


def _is_deliberate(error: Exception) -> bool:
    """Return whether hpop raised it on purpose, or a warning was made one: it says by itself what is wrong."""
    if type(error).__module__.partition(".")[0] == "hpop" or isinstance(error, Warning):
        return True
    place = extract_tb(error.__traceback__)[-1]
    is_own = Path(place.filename).is_relative_to(Path(__file__).parents[1])
    return is_own and isinstance(error, TypeError | ValueError) and (place.line or "").startswith("raise ")


def _named(error: Exception) -> Exception:
    """Return an error that a function around may explain better, by an argument of its own."""
    setattr(error, GUARDED, True)
    return error


def misfit(value: Any, hint: Any) -> str:
    """Say what was expected, where a value is not of a type; "" where it is, or where nothing is known of the type."""
    return "" if fits(value, hint) else expected(hint)


def extreme(value: Any) -> str:
    """Say what was expected, where a value is of the right type, but empty or of a size that nothing computes with."""
    if isinstance(value, int | float | np.number) and not isinstance(value, bool):
        number: Any = value
        finite = isinstance(value, int) or bool(np.isfinite(number))
        return "" if finite and abs(number) < LARGEST else "a finite number below 2^63 in size"
    if isinstance(value, np.ndarray):
        if not value.size:
            return EMPTY
        return "finite" if value.dtype.kind == "f" and not np.isfinite(value).all() else ""
    if isinstance(value, str | bytes) or not isinstance(value, Collection):
        return "" if not isinstance(value, str) or value else EMPTY
    if not len(value):
        return EMPTY
    entries = _first(value.values() if isinstance(value, Mapping) else value)
    return next((f"of entries that are each {wrong}" for wrong in map(extreme, entries) if wrong), "")


def fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of a type; of the entries of a collection the first few are looked at."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin is Annotated:
        return fits(value, parts[0])
    if origin in (Union, UnionType):
        return any(fits(value, part) for part in parts)
    if origin is Literal:
        return any(value is part or (isinstance(value, str) and value == part) for part in parts)
    if hint is AnyColumn or hint is AnyArray or origin is np.ndarray or hint is np.ndarray:
        return _is_array(value, hint)
    if hint is float:
        return isinstance(value, Real) and not isinstance(value, bool | np.bool_)
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool | np.bool_)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if origin is type:
        return isinstance(value, type)
    cls = origin or hint
    if cls is Callable or cls is cast(Any, Callable[..., Any]).__origin__:
        return callable(value)
    if not isinstance(cls, type):
        return True
    if issubclass(cls, Mapping):
        return isinstance(value, Mapping) and (
            len(parts) != 2
            or all(fits(key, parts[0]) and fits(entry, parts[1]) for key, entry in _first(value.items()))
        )
    if issubclass(cls, tuple | list | set | frozenset) or cls in COLLECTIONS:
        return _is_collection(value, cls, parts)
    if getattr(cls, "_is_protocol", False):
        return all(hasattr(value, name) for name in _members(cast(Any, cls)))
    if issubclass(cls, str) and cls is not str and isinstance(value, str):  # an enumeration's value
        return value in set(cast(Iterable[Any], cls))
    return isinstance(value, cls)


COLLECTIONS = tuple(get_origin(kind) for kind in (Iterable[Any], Collection[Any], Sequence[Any], Iterator[Any]))


def expected(hint: Any) -> str:
    """Describe a type in words, for people."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return expected(parts[0])
    if origin in (Union, UnionType):
        words = dict.fromkeys(map(expected, parts))
        if str in parts and any(_is_path(part) for part in parts):
            words = {"a path": None} | {word: None for word in words if word not in ("text", "a PathLike", "a Path")}
        return " or ".join(words)
    if origin is Literal:
        return f"one of {', '.join(map(str, parts))}"
    cls = origin or hint
    if cls in WORDS:
        return WORDS[cls]
    if not isinstance(cls, type):
        return "something else"
    if callable(hint) and cls is get_origin(Callable[..., Any]):
        return "a function"
    if issubclass(cls, Mapping):
        known = len(parts) == 2 and Any not in parts
        return f"a dict ({expected(parts[0])}: {expected(parts[1])})" if known else "a dict"
    entries = [part for part in parts if part is not Ellipsis]
    if issubclass(cls, tuple) and parts and Ellipsis not in parts:
        return f"{len(parts)} values ({', '.join(map(expected, parts))})"
    if issubclass(cls, tuple | list | set | frozenset) or cls in COLLECTIONS:
        known = len(entries) == 1 and isinstance(get_origin(entries[0]) or entries[0], type)
        return f"a list (each {expected(entries[0])})" if known else "a list"
    builders = [name for name in dir(cls) if BUILDERS.fullmatch(name) and inspect.ismethod(getattr(cls, name))]
    made = f" (made by {cls.__name__}, {', '.join(f'{cls.__name__}.{name}' for name in builders)})" if builders else ""
    return article(cls.__name__) + made


def _is_array(value: Any, hint: Any) -> bool:
    """Return whether it is an array of numbers, or becomes one; a single number is none where an array has axes."""
    if hint is AnyColumn and type(value).__module__.partition(".")[0] == "casadi":
        return True
    if isinstance(value, str | Mapping):
        return False
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        return False
    return array.dtype.kind in "biuf" and (hint is AnyColumn or array.ndim > 0)


def _is_collection(value: Any, cls: Any, parts: tuple[Any, ...]) -> bool:
    """Return whether a value is a collection whose first entries fit; an iterator is not used up."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        return False
    if not isinstance(value, Collection) or (isinstance(value, Mapping) and cls not in (Iterable, Collection)):
        return cls in (Iterable, Iterator)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return False
    if issubclass(cls, tuple) and parts and Ellipsis not in parts:
        return len(value) == len(parts) and all(fits(one, part) for one, part in zip(value, parts, strict=True))
    entries = [part for part in parts if part is not Ellipsis]
    return len(entries) != 1 or all(fits(one, entries[0]) for one in _first(value))


def _first(values: Iterable[Any]) -> list[Any]:
    """Return the first few."""
    return [one for one, _ in zip(values, range(LOOKED_AT), strict=False)]


def _is_path(hint: Any) -> bool:
    cls = get_origin(hint) or hint
    return isinstance(cls, type) and (cls is os.PathLike or hasattr(cls, "__fspath__"))


@lru_cache
def _members(protocol: Any) -> tuple[str, ...]:
    """Return names that a protocol asks for."""
    names: dict[str, None] = {}
    for cls in protocol.__mro__:
        if getattr(cls, "_is_protocol", False):
            names |= dict.fromkeys([*vars(cls), *inspect.get_annotations(cls)])
    return tuple(name for name in names if not name.startswith("_"))


def _hints(function: Callable[..., Any], owner: type | None) -> dict[str, Any]:
    """Return types of the parameters, of those that can be told; names for type checkers alone are imported."""
    names: dict[str, Any] = {}
    for module in [*(cls.__module__ for cls in reversed(owner.__mro__ if owner else ())), function.__module__]:
        if module in sys.modules and module.partition(".")[0] not in ("builtins", "typing", "abc"):
            names |= _for_type_checkers(module) | vars(sys.modules[module])
    names |= ALIASES
    found = {}
    for name, annotation in inspect.get_annotations(function).items():
        annotation = getattr(annotation, "__forward_arg__", annotation)
        try:
            found[name] = eval(annotation, names) if isinstance(annotation, str) else annotation
        except Exception:  # a type that cannot be told is not compared
            found[name] = Any
    return found


@lru_cache
def _for_type_checkers(module: str) -> dict[str, Any]:
    """Return the names that a module imports ``if TYPE_CHECKING``."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError, SyntaxError):
        return {}
    found: dict[str, Any] = {}
    for block in tree.body:
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING":
            for line in block.body:
                if isinstance(line, ast.ImportFrom) and line.module and not line.level:
                    source = import_module(line.module)
                    found |= {one.asname or one.name: getattr(source, one.name, Any) for one in line.names}
    return found
