"""Check a table of a TOML file against a msgspec Struct, and say everything that is wrong with it at once.

msgspec itself stops at the first mistake. This walk goes on, and names for each the key, what was found,
what is allowed, and the nearest known key.
"""

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

import msgspec
from msgspec import inspect as shape

S = TypeVar("S", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in a file."""

    key: str  # such as robots[1].sensor.gain; "" for the file as a whole
    found: str
    allowed: str = ""
    nearest: str = ""  # the known key or value that is most like what was found

    def __str__(self) -> str:
        parts = [f"{self.key}: found {self.found}" if self.key else self.found]
        if self.allowed:
            parts.append(f"allowed: {self.allowed}")
        if self.nearest:
            parts.append(f"nearest known: {self.nearest}")
        return "; ".join(parts)


def convert(raw: Mapping[str, Any], kind: type[S], directory: str | Path | None = None) -> S:
    """The Struct of a table, strictly. Keys of type Path are taken from `directory`, or as written if None.

    Raises:
        msgspec.ValidationError: at the first mistake.
    """
    return msgspec.convert(raw, kind, strict=True, dec_hook=lambda to, value: _path(to, value, directory))


def resolve_path(directory: str | Path | None, value: str | Path) -> Path:
    """A path of a mission: `~` is the home directory, and a relative one begins at `directory`."""
    path = Path(value).expanduser()
    return path if directory is None else Path(directory) / path


def check(raw: Any, kind: type[msgspec.Struct], where: str = "") -> list[Problem]:
    """All mistakes of a table that should be a `kind`; `where` is the key path that leads to it."""
    if not isinstance(raw, dict):
        return [Problem(where, show(raw), "a table")]
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    problems = []
    meant = set()  # missing keys that an unknown key was probably meant for
    for key, value in raw.items():
        if key in fields:
            problems += _check_value(value, fields[key].type, join(where, key))
        else:
            near = nearest(key, set(fields) - set(raw)) or nearest(key, fields)
            meant.add(near)
            known = ", ".join(fields) or "no key at all"
            problems.append(Problem(join(where, key), f"an unknown key (= {show(value)})", known, near))
    for name, field in fields.items():
        if field.required and name not in raw and name not in meant:
            problems.append(Problem(join(where, name), "nothing", describe(field.type)))
    if not problems:
        problems += _convert_problem(raw, kind, where)  # the Struct's own __post_init__ has the last word
    return problems


def not_finite(raw: Any, where: str = "") -> list[Problem]:
    """The keys that hold nan or inf, which TOML can write and nothing here can use."""
    if isinstance(raw, float) and not math.isfinite(raw):
        return [Problem(where, show(raw), "a finite number")]
    if isinstance(raw, dict):
        return [p for key, value in raw.items() for p in not_finite(value, join(where, key))]
    if isinstance(raw, list):
        return [p for i, value in enumerate(raw) for p in not_finite(value, f"{where}[{i}]")]
    return []


def join(where: str, key: str) -> str:
    """The path of a key in the table at `where`."""
    return f"{where}.{key}" if where else key


def nearest(word: str, known: Iterable[str]) -> str:
    """The most similar known word, or "". A wrong unit counts less than a wrong name."""
    names = sorted(known)
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    if near:
        return near[0]
    stem = word.split("_", maxsplit=1)[0]
    return next((name for name in names if name.split("_")[0] == stem), "")


def show(value: Any) -> str:
    """A value as the file has it, short."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    text = f'"{value}"' if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def describe(kind: Any) -> str:
    """What a key of this type may hold, in words."""
    return _words(kind if isinstance(kind, shape.Type) else shape.type_info(kind))


def _words(info: shape.Type) -> str:
    match info:
        case shape.IntType():
            return "a whole number" + _range(info)
        case shape.FloatType():
            return "a number" + _range(info)
        case shape.BoolType():
            return "true or false"
        case shape.StrType(pattern=str(pattern)):
            return f"text that matches {pattern}"
        case shape.StrType():
            return "text"
        case shape.LiteralType(values=values):
            return "one of " + ", ".join(show(value) for value in values)
        case shape.EnumType(cls=cls):
            return "one of " + ", ".join(show(member.value) for member in cls)
        case shape.ListType() | shape.VarTupleType():
            return f"a list{_length(info.min_length, info.max_length)}, each {_words(info.item_type)}"
        case shape.TupleType(item_types=items):
            return f"a list of {len(items)} values: " + ", ".join(_words(item) for item in items)
        case shape.UnionType(types=types):
            return " or ".join(_words(kind) for kind in types if not isinstance(kind, shape.NoneType))
        case shape.CustomType(cls=cls) if cls is Path:
            return "a path"
        case _:
            return "a table"


def _range(info: shape.IntType | shape.FloatType) -> str:
    words = []
    for bound, sign in ((info.gt, ">"), (info.ge, ">="), (info.lt, "<"), (info.le, "<=")):
        if bound is not None:
            words.append(f"{sign} {bound:g}" if abs(bound) < 1e6 else f"{sign} {bound}")
    return " " + " and ".join(words) if words else ""


def _length(low: int | None, high: int | None) -> str:
    if low is not None and high is not None:
        return f" of {low} values" if low == high else f" of {low} to {high} values"
    return f" of at least {low} values" if low else ""


def _check_value(value: Any, kind: Any, where: str) -> list[Problem]:
    inner, item = _struct_in(kind)
    if inner is not None:
        return check(value, inner, where)
    if item is not None and isinstance(value, list):
        problems = [p for i, entry in enumerate(value) for p in check(entry, item, f"{where}[{i}]")]
        if problems:
            return problems
    return _convert_problem(value, kind, where)


def _struct_in(kind: Any) -> tuple[type[msgspec.Struct] | None, type[msgspec.Struct] | None]:
    """The Struct that a type is (or may be, beside None), and the Struct that it is a list of."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind, None
    arguments = [part for part in get_args(kind) if part not in (type(None), ...)]
    if len(arguments) == 1:
        inner = _struct_in(arguments[0])[0]
        return (None, inner) if get_origin(kind) in (list, tuple) else (inner, None)
    return None, None


def _convert_problem(value: Any, kind: Any, where: str) -> list[Problem]:
    try:
        msgspec.convert(value, kind, strict=True, dec_hook=lambda to, raw: _path(to, raw, None))
    except msgspec.ValidationError as error:
        text, _, tail = str(error).partition(" - at `$")
        path = tail.rstrip("`")
        info = shape.type_info(kind)
        for step in re.findall(r"\[(\d+)\]", path):
            if isinstance(value, list) and isinstance(info, shape.ListType | shape.VarTupleType):
                value, info = value[int(step)], info.item_type
        structural = text.startswith(("Expected", "Invalid"))
        allowed = (
            describe(kind) if structural else text
        )  # what a __post_init__ says is for the reader as it is
        return [Problem(where + path, show(value), allowed, _nearest_choice(value, kind))]
    return []


def _nearest_choice(value: Any, kind: Any) -> str:
    info = shape.type_info(kind)
    if isinstance(info, shape.LiteralType) and isinstance(value, str):
        return nearest(value, [choice for choice in info.values if isinstance(choice, str)])
    return ""


def _path(to: type, value: Any, directory: str | Path | None) -> Any:
    if to is not Path or not isinstance(value, str):
        raise ValueError(f"Expected `str`, got {show(value)}")
    return Path(value) if directory is None else resolve_path(directory, value)
