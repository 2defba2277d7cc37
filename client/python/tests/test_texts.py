"""Shaders, targets and options as text: the table that the core reads too."""
from __future__ import annotations

import json
import math
import pathlib
from typing import Any

import numpy
import pytest

from voxelpipe import InvalidRequest, Shader, Target
from voxelpipe._proto.voxelpipe.v1 import request_pb2
from voxelpipe.options import make_request

TABLE = pathlib.Path(__file__).resolve().parents[3] / "tests" / "unit" / "request_text" / "request_cases.json"
CASES: list[dict[str, Any]] = json.loads(TABLE.read_text(encoding="utf-8"))
KEYS = ("encoding", "clear", "scale", "quantum", "fill")


def shown(value: Any) -> Any:
    """A value as the table has it: lists of numbers, infinities as texts."""
    if isinstance(value, str) or value is None:
        return value
    numbers = ["-inf" if n == -math.inf else "inf" if n == math.inf else n for n in numpy.atleast_1d(value).tolist()]
    return numbers


def shader_json(shader: Shader) -> dict[str, Any]:
    """A shader as the table has it."""
    parameters = {name: shown(value) for name, value in shader.parameters.items()}
    return {"name": shader.name, **({"parameters": parameters} if parameters else {})}


def target_json(target: Target, default: Shader, expected: dict[str, Any]) -> dict[str, Any]:
    """A target as the table has it: fields that it names, and those that differ from a target's defaults."""
    found: dict[str, Any] = {
        "format": target.format,
        "components": target.components,
        "blend": target.blend or ("or" if target.format == "bit" else "replace"),
        "shader": shader_json(target.shader or default),
    }
    for key in KEYS:
        value = getattr(target, key)
        if key in expected or value != getattr(Target(), key):
            found[key] = shown(value) if key in ("encoding", "fill") else shown(value)[0]
    return found


def parts_json(parts: request_pb2.PartSelection) -> dict[str, Any]:
    """Parts as the table has them."""
    return {
        "scope": request_pb2.PartScope.Name(parts.scope).removeprefix("PART_SCOPE_").lower(),
        "labels": [[rule.pattern, rule.number] for rule in parts.labels],
        "priorities": [[rule.pattern, rule.number] for rule in parts.priorities],
        "exclude": list(parts.exclude),
    }


def request_json(given: dict[str, Any]) -> dict[str, Any]:
    """What options make of a request: its parts if they are named, else its grid if it is placed, else its vertex
    shader, as the table has them."""
    options: dict[str, Any] = dict(given)
    for name in {"dims", "origin", "voxel_size"} & set(given):
        numbers = [float(number) for number in given[name].split(",")]
        options[name] = numbers if len(numbers) > 1 else numbers[0]
    spec = make_request(**options).spec
    if "parts" in given:
        return {"parts": parts_json(spec.parts)}
    if spec.grid.HasField("placement"):
        grid: Any = spec.grid.placement
        names = ("dims", "origin", "voxel_size")
        return {"grid": {name: [getattr(getattr(grid, name), axis) for axis in "xyz"] for name in names}}
    call = spec.vertex_shader
    values = {one.name: one.numbers.values for one in call.parameters}
    return {"vertex_shader": shader_json(Shader(call.name or "identity", values))}


def test_the_table_is_there() -> None:
    assert len(CASES) >= 150


@pytest.mark.parametrize("case", CASES, ids=[json.dumps([*case.values()][0]) for case in CASES])
def test_a_text_means_what_the_table_says(case: dict[str, Any]) -> None:
    default = Shader.parse(case.get("default_shader", "occupancy"))
    text = case.get("target", case.get("shader"))

    def parsed() -> dict[str, Any]:
        if "options" in case:
            return request_json(case["options"])
        if "shader" in case:
            return shader_json(Shader.parse(text))
        return target_json(Target.parse(text, "", default), default, case.get("is", {}))

    if "error" in case:
        with pytest.raises(InvalidRequest) as caught:
            parsed()
        place = "shader" if "shader" in case else "targets"
        message = case["error"] if "options" in case else f"{place}: {case['error']}"
        assert caught.value.message == message and caught.value.field == message.partition(":")[0]
    else:
        assert parsed() == case["is"]


def test_the_names_of_the_table_are_those_of_the_contract() -> None:
    for case in CASES:
        if "target" in case and "is" in case:
            assert request_pb2.VoxelFormat.Value(f"VOXEL_FORMAT_{case['is']['format'].upper()}")
            assert request_pb2.Blend.Value(f"BLEND_{case['is']['blend'].upper()}")
