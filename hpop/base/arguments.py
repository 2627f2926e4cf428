"""Errors that name the wrong argument of a public function: the decorator :func:`checked_arguments`.

An argument of a wrong type usually causes an error deep inside hpop, about an object that the caller never saw. If a
call of a decorated function fails, its arguments are compared with the type hints. A TypeError or ValueError then says
which argument is wrong, what was expected and what came. A call that succeeds is never rejected. Errors that
hpop raises on purpose pass unchanged.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import sys
import sysconfig
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, wraps
from importlib import import_module
from numbers import Integral, Real
from pathlib import Path
from traceback import extract_tb, walk_tb
from types import FunctionType, NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin

import numpy as np

from hpop.base.text import article, call_fault, shown

T = TypeVar("T", bound=Callable[..., Any])

INSTALLED = [Path(__file__).parents[1], *(Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib"))]
"""Folders of the code of hpop, of Python and of installed packages."""
GUARDED = "_names_arguments"
"""Attribute that marks decorated functions, and errors that were raised by this module."""
OF_EXTREMES = re.compile(
    r"empty|zero-size|shape|dimension|at least one|shorter|'list'|\bnan\b|\binf|finite|out of (range|bounds)|too large|"
    r"convert|overflow|maxsize|division|sequence",
    re.IGNORECASE,
)
"""Words in messages of errors that are caused by empty, huge or non-finite values."""
LARGEST = 2**63
"""Numbers of at least this size overflow in computations."""
EMPTY = "not empty"
"""Text on what was expected, if a collection or text is empty."""
CHECKED_ENTRIES = 20
"""Number of entries of a collection that are compared with a type."""
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
"""Pattern of the names of class methods that make an instance."""


class AnyColumn:
    """Type that is checked in place of the alias ``Column``: an array, a number or CasADi's symbols."""


class AnyArray:
    """Type that is checked in place of the alias ``ArrayLike``: an array, or nested sequences of numbers."""


WORDS |= {AnyColumn: "an array of numbers", AnyArray: "an array of numbers"}
ALIASES = {"Column": AnyColumn, "ArrayLike": AnyArray}
"""Types that are checked in place of aliases, such as ``Column = Any``, which would allow more than is meant."""


def checked_arguments(target: T) -> T:
    """Decorate a function, or a class with its public methods, so that errors name a wrong argument.

    >>> @checked_arguments
    ... def doubled(values: Sequence[float]) -> list[float]:
    ...     return [2 * value for value in values]
    >>> doubled(None)
    Traceback (most recent call last):
    TypeError: doubled: values must be a list (each a number), got None
    """
    if not isinstance(target, type):
        return cast(T, _explaining_wrapper(target, None))
    for name in dir(target):
        if name.startswith("_") and name != "__init__":
            continue
        value = inspect.getattr_static(target, name)
        kind, function = type(value), getattr(value, "__func__", value)
        home = getattr(function, "__module__", "").partition(".")[0]
        is_own = home in ("hpop", target.__module__.partition(".")[0])  # not of a library's class
        if isinstance(function, FunctionType) and is_own and not hasattr(function, GUARDED):
            owner = next(cls for cls in target.__mro__ if name in vars(cls))
            guarded = _explaining_wrapper(function, owner)
            setattr(target, name, guarded if kind is FunctionType else kind(guarded))
    return cast(T, target)


def _explaining_wrapper(function: Callable[..., Any], owner: type | None) -> Callable[..., Any]:
    """Return a wrapper of a function; if a call fails because of a wrong argument, its error names the argument.

    ``owner`` is the class of a method, or None for a function.
    """
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
    """Raise an error that names the wrong argument of a failed call.

    Return without raising if no argument is wrong, or if ``error`` names the argument already.
    """
    if _is_deliberate(error) and not hasattr(error, GUARDED):
        return
    hints, signature = _resolved_hints(function, owner), inspect.signature(function)
    title = f"{owner.__name__}.{function.__name__}".removesuffix(".__init__") if owner else function.__name__
    try:
        bound = signature.bind(*args, **kwargs)
    except TypeError:
        if fault := call_fault(signature, args, kwargs):
            raise _marked_as_named(TypeError(f"{title}: {fault}")) from None
        return  # Python's own error names missing arguments
    arguments: list[tuple[str, Any]] = []
    needed = {name for name, each in signature.parameters.items() if each.default is each.empty}
    for name, value in bound.arguments.items():
        kind = signature.parameters[name].kind
        if kind is inspect.Parameter.VAR_KEYWORD:
            arguments += [(key, each) for key, each in value.items()]
            hints |= dict.fromkeys(value, hints.get(name, Any))
        elif kind is inspect.Parameter.VAR_POSITIONAL:
            arguments += [(name, each) for each in value]
        elif name not in ("self", "cls"):
            arguments.append((name, value))
    message, ours, is_users = str(error), hasattr(error, GUARDED), _is_of_user(error, function)
    cause = error.__cause__ if ours else error
    misfits = [(TypeError, name, value, misfit(value, hints.get(name, Any))) for name, value in arguments]
    extremes = [
        (ValueError, name, value, extreme(value))
        for name, value in arguments
        if not is_users
        and (name in needed or isinstance(value, Real | list | np.ndarray))
        and (isinstance(error, OverflowError | MemoryError) or OF_EXTREMES.search(message))
    ]
    for raised, name, value, wrong in (*misfits, *extremes):
        if wrong == EMPTY and isinstance(error, OverflowError | MemoryError):
            continue  # empty values neither overflow nor fill memory
        if wrong:
            if not ours and isinstance(error, TypeError | ValueError) and re.search(rf"\b{re.escape(name)}\b", message):
                return
            raise _marked_as_named(raised(f"{title}: {name} must be {wrong}, got {shown(value)}")) from cause
    if is_users:
        return
    for name, value in arguments:
        if isinstance(value, str) and isinstance(error, LookupError | AttributeError) and repr(value) in message:
            raise _marked_as_named(ValueError(f"{title}: there is no {name} {shown(value)}")) from cause
    numbers: list[tuple[str, Any]] = [each for each in arguments if isinstance(each[1], int | float | np.number)]
    for name, value in sorted(numbers, key=lambda item: -abs(item[1])):
        if value < 0 and "negative" in message:
            raise _marked_as_named(ValueError(f"{title}: {name} must not be negative, got {shown(value)}")) from cause
        if isinstance(error, IndexError):
            raise _marked_as_named(ValueError(f"{title}: {name} is out of range, got {shown(value)}")) from cause


def _is_deliberate(error: Exception) -> bool:
    """Return whether an error has a clear message already: hpop raised it on purpose, or it is a warning."""
    if type(error).__module__.partition(".")[0] == "hpop" or isinstance(error, Warning):
        return True
    place = extract_tb(error.__traceback__)[-1]
    is_own = Path(place.filename).is_relative_to(Path(__file__).parents[1])
    return is_own and isinstance(error, TypeError | ValueError) and (place.line or "").startswith("raise ")


def _is_of_user(error: Exception, function: Callable[..., Any]) -> bool:
    """Return whether an error came through a function of the user, called by ``function``: of a file of its own."""
    own = [*INSTALLED, Path(inspect.unwrap(function).__code__.co_filename)]
    places = (Path(frame.f_code.co_filename) for frame, _ in walk_tb(error.__traceback__))
    return any(place.is_absolute() and not any(map(place.is_relative_to, own)) for place in places)


def _marked_as_named(error: Exception) -> Exception:
    """Return an error after marking that its message names an argument of an inner function."""
    setattr(error, GUARDED, True)
    return error


def misfit(value: Any, hint: Any) -> str:
    """Return the expected type in words if a value does not fit a type hint; "" if it fits."""
    return "" if fits(value, hint) else type_in_words(hint)


def extreme(value: Any) -> str:
    """Return the expected value in words if a value is empty, not finite, or too large to compute with; else ""."""
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
    entries = _first_entries(value.values() if isinstance(value, Mapping) else value)
    return next((f"of entries that are each {wrong}" for wrong in map(extreme, entries) if wrong), "")


def fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of a type; only the first few entries of a collection are checked."""
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
            or all(fits(key, parts[0]) and fits(entry, parts[1]) for key, entry in _first_entries(value.items()))
        )
    if issubclass(cls, tuple | list | set | frozenset) or cls in COLLECTIONS:
        return _is_collection(value, cls, parts)
    if getattr(cls, "_is_protocol", False):
        return all(hasattr(value, name) for name in _public_members(cast(Any, cls)))
    if issubclass(cls, str) and cls is not str and isinstance(value, str):  # an enumeration's value
        return value in set(cast(Iterable[Any], cls))
    return isinstance(value, cls)


COLLECTIONS = tuple(get_origin(kind) for kind in (Iterable[Any], Collection[Any], Sequence[Any], Iterator[Any]))


def type_in_words(hint: Any) -> str:
    """Return a type hint in words, for messages: "a list (each a number)"."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return type_in_words(parts[0])
    if origin in (Union, UnionType):
        words = dict.fromkeys(map(type_in_words, parts))
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
        is_typed = len(parts) == 2 and Any not in parts
        return f"a dict ({type_in_words(parts[0])}: {type_in_words(parts[1])})" if is_typed else "a dict"
    entries = [part for part in parts if part is not Ellipsis]
    if issubclass(cls, tuple) and parts and Ellipsis not in parts:
        return f"{len(parts)} values ({', '.join(map(type_in_words, parts))})"
    if issubclass(cls, tuple | list | set | frozenset) or cls in COLLECTIONS:
        is_typed = len(entries) == 1 and isinstance(get_origin(entries[0]) or entries[0], type)
        return f"a list (each {type_in_words(entries[0])})" if is_typed else "a list"
    builders = [name for name in dir(cls) if BUILDERS.fullmatch(name) and inspect.ismethod(getattr(cls, name))]
    makers = [getattr(cls, "made_by", cls.__name__), *(f"{cls.__name__}.{name}" for name in builders)]
    return article(cls.__name__) + (f" (made by {', '.join(makers)})" if makers != [cls.__name__] else "")


def _is_array(value: Any, hint: Any) -> bool:
    """Return whether a value is an array of numbers or converts to one.

    A plain number counts only if the hint is `AnyColumn`.
    """
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
    """Return whether the entries of a value of class ``cls`` fit the type arguments ``parts``: (int,) for list[int].

    A tuple of fixed length, such as tuple[int, str], is checked entry by entry. For other collections with one type
    argument, the first ``CHECKED_ENTRIES`` entries are checked. Iterators fit if ``cls`` is Iterable or Iterator; their
    entries are not checked, since this would consume them.
    """
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        return False
    if not isinstance(value, Collection) or (isinstance(value, Mapping) and cls not in (Iterable, Collection)):
        return cls in (Iterable, Iterator)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return False
    if issubclass(cls, tuple) and parts and Ellipsis not in parts:
        return len(value) == len(parts) and all(fits(entry, part) for entry, part in zip(value, parts, strict=True))
    entries = [part for part in parts if part is not Ellipsis]
    return len(entries) != 1 or all(fits(entry, entries[0]) for entry in _first_entries(value))


def _first_entries(values: Iterable[Any]) -> list[Any]:
    """Return the first ``CHECKED_ENTRIES`` values."""
    return [value for value, _ in zip(values, range(CHECKED_ENTRIES), strict=False)]


def _is_path(hint: Any) -> bool:
    """Return whether a type hint is that of a path."""
    cls = get_origin(hint) or hint
    return isinstance(cls, type) and (cls is os.PathLike or hasattr(cls, "__fspath__"))


@lru_cache
def _public_members(protocol: Any) -> tuple[str, ...]:
    """Return the names of a protocol's public members."""
    names: dict[str, None] = {}
    for cls in protocol.__mro__:
        if getattr(cls, "_is_protocol", False):
            names |= dict.fromkeys([*vars(cls), *inspect.get_annotations(cls)])
    return tuple(name for name in names if not name.startswith("_"))


def _resolved_hints(function: Callable[..., Any], owner: type | None) -> dict[str, Any]:
    """Return the types of a function's parameters by name; ``Any`` for a type that cannot be resolved.

    Names that a module imports for type checkers only are imported here.
    """
    names: dict[str, Any] = {}
    for module in [*(cls.__module__ for cls in reversed(owner.__mro__ if owner else ())), function.__module__]:
        if module in sys.modules and module.partition(".")[0] not in ("builtins", "typing", "abc"):
            names |= _type_checking_names(module) | vars(sys.modules[module])
    names |= ALIASES
    hints = {}
    for name, annotation in inspect.get_annotations(function).items():
        annotation = getattr(annotation, "__forward_arg__", annotation)
        try:
            hints[name] = eval(annotation, names) if isinstance(annotation, str) else annotation
        except Exception:  # a type that cannot be resolved is not compared
            hints[name] = Any
    return hints


@lru_cache
def _type_checking_names(module: str) -> dict[str, Any]:
    """Return the objects that a module imports for type checkers only (``if TYPE_CHECKING``), by their names."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError, SyntaxError):
        return {}
    imported: dict[str, Any] = {}
    for block in tree.body:
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING":
            for line in block.body:
                if isinstance(line, ast.ImportFrom) and line.module and not line.level:
                    source = import_module(line.module)
                    imported |= {alias.asname or alias.name: getattr(source, alias.name, Any) for alias in line.names}
    return imported
