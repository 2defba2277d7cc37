"""Parts of a mesh: labels, and meshes without some of them."""
from __future__ import annotations

import asyncio
import json
import pathlib
import struct
import subprocess
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe import AsyncClient, Client, InvalidRequest, LocalServer
from voxelpipe.options import make_request

from .. import shapes

LABEL = "label:u16:max"
NAMES = ("hull", "wheel.l", "wheel.r")


def glb(names: tuple[str, ...] = NAMES) -> bytes:
    """Tetrahedra along x, 2 apart, each a node with a name and a mesh with a material of that name in capitals."""
    vertices, faces = shapes.TETRAHEDRON
    points = vertices[faces.ravel()].astype("<f4")
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": points.nbytes}],
        "bufferViews": [{"buffer": 0, "byteLength": points.nbytes}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 12, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}
        ],
        "materials": [{"name": name.upper()} for name in names],
        "meshes": [
            {"name": "m", "primitives": [{"attributes": {"POSITION": 0}, "material": i}]} for i in range(len(names))
        ],
        "nodes": [{"name": name, "mesh": i, "translation": [2 * i, 0, 0]} for i, name in enumerate(names)],
        "scenes": [{"nodes": list(range(len(names)))}],
        "scene": 0,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary: bytes = points.tobytes()
    head: bytes = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary


def labels_of(grid: voxelpipe.VoxelGrid) -> list[int]:
    """The labels in a result, without the 0 of empty voxels."""
    return [int(label) for label in numpy.unique(grid["target0"]) if label != 0]


def test_parts_have_labels(client: Client) -> None:
    def labels(**options: Any) -> list[int]:
        return labels_of(client.voxelize(glb(), resolution=30, targets=LABEL, **options))

    assert labels() == [1]
    assert labels(parts="node") == labels(parts="mesh") == labels(parts="material") == [1, 2, 3]
    assert labels(parts="node", part_label={"*": 9, "wheel?r": 500}) == [9, 500]
    assert labels(parts="node", part_label=["*=9", "wheel?r=500"]) == [9, 500]
    assert labels(parts="material", part_label="HULL=65535") == [2, 3, 65535]
    assert labels(parts="node", part_priority={"hull": -1}) == [1, 2, 3], "without a fill they change nothing"
    assert labels(parts="file") == [1]


def test_files_are_the_placed_meshes(client: Client) -> None:
    there = numpy.eye(4)
    there[1, 3] = 3
    grid = client.voxelize(
        [glb(), glb()],
        together=True,
        transforms=[None, there],
        names=["a", "b"],
        labels=[7, None],
        resolution=30,
        targets=LABEL,
        parts="file",
        part_label={"c": 4},
    )
    assert labels_of(grid) == [2, 7]
    assert [warning.code for warning in grid.warnings] == ["part_not_found"]
    alone = client.voxelize([glb(), glb()], together=True, names=["a", "b"], parts="file", exclude="b")
    assert alone.summary.mesh.triangles == 12


def test_excluded_parts_are_not_in_the_mesh(client: Client) -> None:
    options: dict[str, Any] = {"resolution": 20, "normal": "geometric_normal:f32"}
    alone = client.voxelize(glb(NAMES[:1]), parts="node", **options)
    assert client.voxelize(glb(), parts="node", exclude="wheel*", **options) == alone
    assert client.voxelize(glb(), parts="node", exclude=["wheel.l", "wheel.r"], **options) == alone
    material = client.voxelize(glb(NAMES[:1]), parts="material", **options)
    assert client.voxelize(glb(), parts="material", exclude="W*", **options) == material
    handle = client.upload(glb())
    for _ in range(2):  # the stored mesh stays whole
        assert client.voxelize(handle, parts="node", exclude="wheel*", **options) == alone
        assert client.voxelize(handle, **options) == client.voxelize(glb(), **options)
    filled = client.voxelize(glb(), parts="node", exclude="hull", fill="parity", resolution=20)
    assert filled.summary.mesh.triangles == 8 and filled.summary.mesh.open_edges == 0


def test_all_calls_take_them(client: Client) -> None:
    estimate = client.estimate(glb(), resolution=20, parts="node", exclude="hull")
    assert estimate.mesh is not None and estimate.mesh.triangles == 8
    grids = list(client.voxelize_many([glb(), glb()], resolution=20, parts="node", exclude="hull"))
    assert [grid.summary.mesh.triangles for grid in grids] == [8, 8]  # type: ignore[union-attr]


def test_a_pattern_without_a_part_is_a_warning(client: Client) -> None:
    grid = client.voxelize(glb(), resolution=20, parts="node", exclude="door")
    assert [warning.code for warning in grid.warnings] == ["part_not_found"]
    assert grid.warnings[0].text == "no part is called 'door'; there are 'hull', 'wheel.l', 'wheel.r'"
    with pytest.raises(InvalidRequest, match="no part is called 'door'"):
        client.voxelize(glb(), resolution=20, parts="node", part_label={"door": 2}, strict=True)
    nothing = client.voxelize(glb(), resolution=20, parts="node", exclude="*")
    assert nothing.summary.occupied == 0
    assert [warning.code for warning in nothing.warnings] == ["no_triangles"]


def test_a_format_that_does_not_hold_a_label_is_refused(client: Client) -> None:
    with pytest.raises(InvalidRequest, match="u8 does not hold the label 300 exactly") as caught:
        client.voxelize(glb(), parts="node", part_label={"hull": 300}, targets="label:u8:max")
    assert caught.value.field == "targets[0].format"


def test_module_and_asynchronous_calls_take_them(server: LocalServer) -> None:
    options: dict[str, Any] = {"resolution": 20, "parts": "node", "exclude": "hull", "targets": LABEL}
    expected = voxelpipe.voxelize(glb(), server=server, **options)
    assert labels_of(expected) == [1, 2]

    async def run() -> voxelpipe.VoxelGrid:
        async with AsyncClient(server.server) as opened:
            return await opened.voxelize(glb(), **options)

    assert asyncio.run(run()) == expected


def test_the_command_line_gives_the_same(server: LocalServer, cli: str, tmp_path: pathlib.Path) -> None:
    (tmp_path / "car.glb").write_bytes(glb())
    command = [cli, "voxelize", "car.glb", "-o", "out.npy", "--resolution", "20", "--parts", "node"]
    command += ["--part-label", "*=3", "--part-label", "wheel.r=8", "--exclude", "hull", "--target", LABEL]
    expected = voxelpipe.voxelize(
        glb(),
        server=server,
        resolution=20,
        parts="node",
        part_label={"*": 3, "wheel.r": 8},
        exclude="hull",
        targets=LABEL,
    )
    assert labels_of(expected) == [3, 8]
    here: list[str] = []
    for where in (here, ["--server", server.server]):
        subprocess.run([*command, *where], cwd=tmp_path, check=True, capture_output=True)
        assert numpy.array_equal(numpy.load(tmp_path / "out.npy"), expected["target0"])


@pytest.mark.parametrize(
    "options, message",
    [
        ({"parts": 7}, "parts: unknown choice '7'; known are whole, file, node, mesh, material"),
        ({"parts": "node", "part_label": 7}, "part_label: 7 is neither a text nor a list of texts"),
        ({"parts": "node", "part_label": {"a": 0}}, "part_label: 0 is no whole number from 1 to 4294967295"),
        ({"parts": "node", "part_label": {"a": 1.5}}, "part_label: 1.5 is no whole number from 1 to 4294967295"),
        ({"parts": "node", "part_label": {"a": True}}, "part_label: True is no whole number from 1 to 4294967295"),
        ({"parts": "node", "part_label": {7: 1}}, "part_label: 7 is no text"),
        ({"parts": "node", "part_label": {"\ud800": 1}}, "part_label: '\\ud800' is no Unicode text"),
        ({"parts": "node", "part_priority": [("a", 1)]}, "part_priority: ('a', 1) is no text"),
        ({"parts": "node", "exclude": {"a": 1}}, "exclude: {'a': 1} is neither a text nor a list of texts"),
        ({"parts": "node", "exclude": b"a"}, "exclude: b'a' is neither a text nor a list of texts"),
        ({"parts": "node", "exclude": ["a", None]}, "exclude: None is no text"),
        ({"parts": "node", "exclude": ["a"] * 1001}, "exclude: 1001 given; at most 1000"),
        ({"exclude": "a"}, "exclude: goes with parts file, node, mesh or material"),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        make_request(**options)
    assert caught.value.message == message and caught.value.field == message.partition(":")[0]


def test_numpy_numbers_and_no_rules_are_taken() -> None:
    labels: Any = {"a": numpy.uint32(7)}
    parts = make_request(parts="node", part_label=labels, exclude=("b", "c")).spec.parts
    assert parts.labels[0].number == 7 and list(parts.exclude) == ["b", "c"]
    assert make_request(part_label={}, part_priority=None, exclude=[]).spec == make_request().spec
