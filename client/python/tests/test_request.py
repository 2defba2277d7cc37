"""Options of a request."""
from __future__ import annotations

from typing import Any, Callable

import numpy
import pytest

import voxelpipe
from voxelpipe import GridPlace, InvalidRequest, Shader, Target, UnknownOption
from voxelpipe._proto.voxelpipe.v1 import request_pb2
from voxelpipe.options import make_request

from . import shapes


@pytest.mark.parametrize(
    "text, expected",
    [
        ("bit", Target()),
        ("base_color:srgb8", Target("u8", encoding="srgb", shader=Shader("base_color"))),
        ("normal:f32", Target("f32", shader=Shader("normal"))),
        ("normal", Target("f32", shader=Shader("normal"))),
        ("occupancy", Target("bit", shader=Shader("occupancy"))),
        ("triangle_id:u32:max", Target("u32", blend="max", shader=Shader("triangle_id"))),
        (
            "attribute(_TEMPERATURE):f32x1:average",
            Target("f32", 1, "average", Shader("attribute", {"name": "_TEMPERATURE"})),
        ),
        ("f32x3:replace:shader=normal", Target("f32", 3, "replace", Shader("normal"))),
        ("u8:max:shader=base_color,encoding=srgb", Target("u8", None, "max", Shader("base_color"), encoding="srgb")),
        ("normal:u8:encoding=snorm", Target("u8", shader=Shader("normal"), encoding="snorm")),
        ("constant:f32x3:value=0.5/0.2/1", Target("f32", 3, shader=Shader("constant", {"value": [0.5, 0.2, 1.0]}))),
        (
            "f32:add:clear=-1,fill=0/0.5/1,quantum=0.5",
            Target("f32", None, "add", clear=-1, fill=[0, 0.5, 1], quantum=0.5),
        ),
    ],
)
def test_targets_from_text(text: str, expected: Target) -> None:
    assert Target.parse(text) == expected


@pytest.mark.parametrize(
    "text",
    ["", "normal:f33", "f32x5", "bit:bit", "normal:f32:replace:add", "normal:f32:shader=uv", "a b"],
)
def test_wrong_targets_are_named(text: str) -> None:
    with pytest.raises(InvalidRequest):
        make_request(targets=[text] if text else [])


@pytest.mark.parametrize(
    "options, field",
    [
        ({"resolution": 8, "voxel_size": 0.1}, "resolution"),
        ({"resolution": 0}, "resolution"),
        ({"resolution": 1.5}, "resolution"),
        ({"dims": (1, 2, 3), "resolution": 8}, "resolution"),
        ({"dims": (1, 2, 3), "voxel_size": 1}, "origin"),
        ({"dims": (1, 2, 0)}, "dims"),
        ({"origin": (1, 2, 3)}, "dims"),
        ({"dims": (1, 2, 3), "origin": (0, 0, 0)}, "voxel_size"),
        ({"dims": (1, 2), "origin": (0, 0, 0), "voxel_size": 1}, "dims"),
        ({"dims": (1, 2, 0), "origin": (0, 0, 0), "voxel_size": 1}, "dims"),
        ({"voxel_size": -1}, "voxel_size"),
        ({"voxel_size": (1, 2)}, "voxel_size"),
        ({"voxel_size": float("nan")}, "voxel_size"),
        ({"coverage": "all"}, "coverage"),
        ({"fill": "odd"}, "fill"),
        ({"result": "list"}, "result"),
        ({"backend": "gpu"}, "backend"),
        ({"like": GridPlace((1, 1, 1), (0, 0, 0), (1, 1, 1)), "padding": 1}, "like"),
        ({"like": GridPlace((1, 1, 1), (0, 0, 0), (1, 1, 1)), "fit": "cube"}, "like"),
        ({"like": GridPlace((1, 1, 1), (0, 0, 0), (1, 1, 1)), "clip": "0,0,0,1,1,1"}, "like"),
        ({"clip": 7}, "clip"),
        ({"clip": [[0, 1], [0, 1], [0, 1]]}, "clip"),
        ({"clip": [[0, 0, 0], [1, 1]]}, "clip"),
        ({"clip": (0, 0, 0, 1, 1, None)}, "clip"),
        ({"axes": 7}, "axes"),
        ({"axes": (1, 2, 3)}, "axes"),
        ({"axes": ("x", "y")}, "axes"),
        ({"voxel_size": 1, "fit": "cube"}, "fit"),
        ({"dims": (1, 2, 3), "fit": "cube"}, "fit"),
        ({"targets": ["bit"] * 9}, "targets"),
        ({"targets": ["bit"], "color": "base_color:u8"}, "targets"),
        ({"targets": [Target(name="a"), Target(name="a")]}, "targets"),
        ({"resolution": "x"}, "resolution"),
        ({"resolution": [8]}, "resolution"),
        ({"padding": "1"}, "padding"),
        ({"padding": 10**30}, "padding"),
        ({"resolution": 10**30}, "resolution"),
        ({"strict": "yes"}, "strict"),
        ({"packed_bits": 1}, "packed_bits"),
        ({"dims": {1, 2, 3}}, "dims"),
        ({"padding": -1}, "padding"),
        ({"like": "solid"}, "like"),
        ({"dims": 3, "origin": (0, 0, 0), "voxel_size": 1}, "dims"),
        ({"targets": 7}, "targets"),
        ({"targets": ["bit", None]}, "targets"),
        ({"shader": 7}, "shader"),
        ({"vertex_shader": 7}, "vertex_shader"),
        ({"vertex_shader": "a b"}, "vertex_shader"),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], field: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        make_request(**options)
    assert caught.value.field == field
    assert caught.value.code == "INVALID_ARGUMENT"
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    "keyword, value, hint",
    [
        ("resolutoin", 3, "did you mean resolution="),
        ("resolutoin", "bit", "did you mean resolution="),
        ("shaders", "normal", "did you mean shader="),
        ("part_labels", {"a": 1}, "did you mean part_label="),
        ("excludes", "a", "did you mean exclude="),
        ("dim", "bit", "did you mean dims="),
        ("target", "u8:max", "use targets="),
        ("clips", "0,0,0,1,1,1", "did you mean clip="),
        ("preview", "out.png", "save("),
        ("threads", 2, "only the command line"),
        ("timeout", "bit", "no such option"),
        ("colour", 3, "takes a Target or a text"),
    ],
)
def test_a_keyword_that_is_no_option_becomes_no_target(keyword: str, value: Any, hint: str) -> None:
    with pytest.raises(UnknownOption) as caught:
        make_request(**{keyword: value})
    assert isinstance(caught.value, TypeError) and isinstance(caught.value, InvalidRequest)
    assert caught.value.field == keyword and keyword in caught.value.message and hint in caught.value.message


@pytest.mark.parametrize(
    "name",
    "bits color colour depth heat mask material normal position uv occupancy constant triangle_id barycentric "
    "geometric_normal packed_normal base_color emissive metallic_roughness material_id mesh_id tangent attribute "
    "velocity coverage_fraction checker label part".split(),
)
def test_usual_names_of_targets_are_no_mistaken_options(name: str) -> None:
    assert make_request(**{name: "normal:f32"}).targets[-1].name == name  # type: ignore[arg-type]
    assert make_request(targets=[Target(name="preview")]).targets[0].name == "preview"


def test_a_wrong_target_by_keyword_names_the_keyword() -> None:
    with pytest.raises(InvalidRequest, match="^heat: is no option, so it names a target, but .*'a b' is no shader"):
        make_request(heat="a b")


@pytest.mark.parametrize("timeout", ["x", "3", True, float("nan"), [1]])
def test_a_timeout_that_is_no_number_is_named(timeout: Any, closed_port: str) -> None:
    calls: list[Callable[[], Any]] = [
        lambda: voxelpipe.voxelize(b"", timeout=timeout),
        lambda: voxelpipe.Client(closed_port, timeout=timeout),
        lambda: voxelpipe.AsyncClient(closed_port, timeout=timeout),
        lambda: voxelpipe.Client(closed_port).estimate(shapes.cube(), timeout=timeout),
        lambda: voxelpipe.Client(closed_port).voxelize_many([], timeout=timeout),
    ]
    for call in calls:
        with pytest.raises(InvalidRequest, match="^timeout: .* is no number of seconds") as caught:
            call()
        assert caught.value.field == "timeout"


def test_the_default_is_one_bit_at_128() -> None:
    request = make_request()
    assert request.spec.grid.resolution.voxels == 128
    assert [target.name for target in request.targets] == ["target0"]
    assert request.spec.targets[0].format == request_pb2.VOXEL_FORMAT_BIT


def test_keywords_name_targets_after_a_mask() -> None:
    request = make_request(color="base_color:srgb8", normal="normal:f32")
    assert [target.name for target in request.targets] == ["mask", "color", "normal"]
    assert request.spec.targets[0].shader.name == "occupancy"
    assert request.spec.targets[1].encoding == request_pb2.ENCODING_SRGB
    assert [target.name for target in make_request(mask="bit:first").targets] == ["mask"]


def test_like_takes_the_grid_of_another_result() -> None:
    grid = make_request(like=GridPlace((4, 5, 6), (10.0, 20.0, 30.0), (0.1, 0.2, 0.4))).spec.grid.placement
    assert (grid.dims.x, grid.dims.y, grid.dims.z) == (4, 5, 6)
    assert (grid.origin.x, grid.origin.y, grid.origin.z) == (10.0, 20.0, 30.0)
    assert (grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z) == (0.1, 0.2, 0.4)


@pytest.mark.parametrize(
    "options, form",
    [
        ({}, "resolution"),
        ({"resolution": 9, "fit": "cube", "padding": 2}, "resolution"),
        ({"voxel_size": (1, 2, 3)}, "voxel_size"),
        ({"dims": (4, 5, 6)}, "dims"),
        ({"dims": (4, 5, 6), "origin": (0, 0, 0), "voxel_size": 0.5}, "placement"),
    ],
)
def test_a_grid_is_given_in_one_of_four_forms(options: dict[str, Any], form: str) -> None:
    grid = make_request(**options).spec.grid
    assert grid.WhichOneof("form") == form and grid.padding == options.get("padding", 0)
    if "fit" in options:
        assert (grid.resolution.voxels, grid.resolution.fit) == (9, request_pb2.GRID_FIT_CUBE)


@pytest.mark.parametrize(
    "options, text",
    [
        ({"voxel_size": 1, "fit": "cube"}, "fit: a cube goes with a resolution, not with a voxel size"),
        ({"dims": (1, 2, 3), "fit": "cube"}, "fit: a cube goes with a resolution, not with dims"),
        ({"origin": (1, 2, 3)}, "dims: an origin is given together with dims and a voxel size"),
        (
            {"dims": (1, 2, 3), "origin": (0, 0, 0)},
            "voxel_size: a grid given by dims and origin needs a voxel size",
        ),
        (
            {"dims": (1, 2, 3), "voxel_size": 1},
            "origin: a grid given by dims and a voxel size needs an origin; dims alone are fitted to the mesh",
        ),
    ],
)
def test_what_no_form_holds_is_refused_as_the_core_does(options: dict[str, Any], text: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        make_request(**options)
    assert caught.value.message == text  # CheckGridRequest of core/grid/grid_spec.cpp


def test_axes_and_clip_as_texts_and_as_values() -> None:
    place = GridPlace((2, 4, 6), (0.5, 1.0, 1.5), (0.5, 0.5, 0.5))
    asked = make_request(axes="x,z,-y", clip="0.5,1,1.5,1.5,3,4.5", resolution=6)
    grid = asked.spec.grid.placement
    assert (grid.dims.x, grid.dims.y, grid.dims.z) == place.dims and asked.spec.grid.padding == 0
    for clip in (place.bounds, place.bounds.ravel().tolist(), tuple(map(tuple, place.bounds))):
        assert make_request(axes=("x", "z", "-y"), clip=clip, resolution=6).message == asked.message
    assert asked.small_result(8 * place.voxels)


def test_axes_turn_a_matrix_of_any_form_once_more() -> None:
    moved = numpy.eye(4)
    moved[:3, 3] = 10, 20, 30
    for matrix in (moved, moved.ravel().tolist(), moved.tolist()):
        spec = make_request(axes="x,z,-y", vertex_shader=Shader("transform", {"matrix": matrix})).spec
        values = {one.name: list(one.numbers.values) for one in spec.vertex_shader.parameters}
        assert values["matrix"] == [1, 0, 0, 10, 0, 0, 1, 30, 0, -1, 0, -20, 0, 0, 0, 1]


@pytest.mark.parametrize(
    "shader", ["transform:matrix=1/2", "transform:matrix=a", "transform:mtrix=1", "identity:dt=1", "identity:center=1"]
)
def test_axes_leave_wrong_parameters_to_the_core(shader: str) -> None:
    given = make_request(vertex_shader=shader).spec.vertex_shader
    assert make_request(axes="x,z,-y", vertex_shader=shader).spec.vertex_shader == given


def test_targets_and_shaders_as_messages() -> None:
    shader = Shader("attribute", {"name": "_HEAT", "scale": 2, "matrix": [[1, 2], [3, 4]]})
    spec = make_request(targets=[Target("f32", shader=shader, clear=-1, fill=[1, 2]), "u8:fill=7"]).spec
    first, second = spec.targets
    assert first.HasField("clear") and first.clear == -1 and first.fill == [1, 2] and second.fill == [7]
    parameters = first.shader.parameters
    values = {one.name: one.text if one.HasField("text") else list(one.numbers.values) for one in parameters}
    assert values == {"name": "_HEAT", "scale": [2], "matrix": [1, 2, 3, 4]}


def test_the_content_hash_is_only_sent_if_it_is_asked_for() -> None:
    for asked in (False, True):
        delivery = make_request(content_hash=asked).message.delivery
        assert delivery.HasField("content_hash") and delivery.content_hash == asked


def test_only_bounded_dense_results_count_as_small() -> None:
    limit = 1 << 20
    assert make_request(resolution=128).small_result(limit)
    assert not make_request(resolution=256).small_result(limit)
    assert not make_request(resolution=128, targets=["normal:f32"]).small_result(limit)
    assert not make_request(voxel_size=1.0).small_result(limit)
    assert not make_request(resolution=8, result="sparse").small_result(limit)
    assert not make_request(resolution=8, parts="node").small_result(limit)
    assert make_request(resolution=8, parts="whole").small_result(limit)
