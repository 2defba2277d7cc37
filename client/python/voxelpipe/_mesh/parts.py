"""The options of parts: which sets of triangles are a solid of their own. As BuildParts of core/request_text."""
from __future__ import annotations

import operator
import re
from typing import Any, Mapping, Sequence, Union, get_args

from .. import names as kinds
from .._proto.voxelpipe.v1 import request_pb2
from ..errors import InvalidRequest

# The number of each pattern, or texts "PATTERN=N"; of those that match the last one holds.
RulesLike = Union[Mapping[str, int], str, Sequence[str], None]

_LABELS = (1, (1 << 32) - 1)
_PRIORITIES = (-(1 << 31), (1 << 31) - 1)
_MAX_RULES = 1000
_WHOLE = re.compile(r"-?[0-9]+", re.ASCII)


def _wrong(option: str, why: str) -> InvalidRequest:
    return InvalidRequest(f"{option}: {why}", field=option)


def _pattern(option: str, pattern: Any) -> str:
    if not isinstance(pattern, str):
        raise _wrong(option, f"{pattern!r} is no text")
    try:
        pattern.encode()
    except UnicodeEncodeError:
        raise _wrong(option, f"{pattern!r} is no Unicode text") from None
    return pattern


def _texts(option: str, texts: Any) -> list[str]:
    if isinstance(texts, str):
        texts = [texts]
    if isinstance(texts, (bytes, bytearray, set, frozenset, Mapping)) or not hasattr(texts, "__iter__"):
        raise _wrong(option, f"{texts!r} is neither a text nor a list of texts")
    return [_pattern(option, text) for text in texts]


def _number(option: str, value: Any, limits: tuple[int, int]) -> int:
    """Of a text, or of anything that is a whole number."""
    shown = f"'{value}'" if isinstance(value, str) else repr(value)
    try:
        if isinstance(value, str):
            number = int(value) if _WHOLE.fullmatch(value) and len(value) < 30 else None
        else:
            number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    if number is None or not limits[0] <= number <= limits[1]:
        raise _wrong(option, f"{shown} is no whole number from {limits[0]} to {limits[1]}")
    return number


def _rules(option: str, given: Any, limits: tuple[int, int]) -> list[request_pb2.PartRule]:
    pairs: list[tuple[str, Any]] = []
    if isinstance(given, Mapping):
        pairs = [(_pattern(option, pattern), number) for pattern, number in given.items()]
    elif given is not None:
        for text in _texts(option, given):
            pattern, equals, number = text.rpartition("=")  # the last one, as a name may hold one
            if not equals:
                raise _wrong(option, f"'{text}' is not of the form PATTERN=N")
            pairs.append((pattern, number))
    return [request_pb2.PartRule(pattern=pattern, number=_number(option, n, limits)) for pattern, n in pairs]


def selection(
    scope: kinds.PartScope, labels: RulesLike, priorities: RulesLike, exclude: str | Sequence[str] | None
) -> request_pb2.PartSelection:
    """The parts of a request. Errors: InvalidRequest naming the option."""
    known = get_args(kinds.PartScope)
    if scope not in known:
        raise _wrong("parts", f"unknown choice '{scope}'; known are {', '.join(known)}")
    parts = request_pb2.PartSelection(
        scope=request_pb2.PartScope.Value(f"PART_SCOPE_{scope.upper()}"),
        labels=_rules("part_label", labels, _LABELS),
        priorities=_rules("part_priority", priorities, _PRIORITIES),
        exclude=[] if exclude is None else _texts("exclude", exclude),
    )
    counts = {"part_label": len(parts.labels), "part_priority": len(parts.priorities), "exclude": len(parts.exclude)}
    for option, count in counts.items():
        if count > 0 and scope == "whole":
            raise _wrong(option, "goes with parts file, node, mesh or material")
        if count > _MAX_RULES:
            raise _wrong(option, f"{count} given; at most {_MAX_RULES}")
    return parts
