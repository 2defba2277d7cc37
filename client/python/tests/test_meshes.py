"""The forms in which a mesh may be given."""
from __future__ import annotations

import io
import json
import pathlib
import struct
import types
from typing import Any

import numpy
import pytest

from voxelpipe import InvalidMesh, Mesh
from voxelpipe._mesh.glb import write_glb
from voxelpipe._mesh.forms import arrays_of, load_mesh

from . import shapes

VERTICES, FACES = shapes.TETRAHEDRON


def read_glb(data: Any) -> tuple[dict[str, Any], bytes]:
    magic, version, length = struct.unpack_from("<4sII", data, 0)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    (size, kind) = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    document = json.loads(bytes(data[20 : 20 + size]))
    return document, bytes(data[28 + size :])


def arrays_in(data: Any) -> tuple[shapes.Array, shapes.Array]:
    document, binary = read_glb(data)
    primitive = document["meshes"][0]["primitives"][0]

    def array(accessor: int, dtype: str) -> shapes.Array:
        entry = document["accessors"][accessor]
        start = document["bufferViews"][entry["bufferView"]]["byteOffset"]
        count = entry["count"] * (3 if entry["type"] == "VEC3" else 1)
        return numpy.frombuffer(binary, dtype, count, start).reshape(-1, 3)

    return array(primitive["attributes"]["POSITION"], "<f4"), array(primitive["indices"], "<u4")


class Meshed:
    """Like trimesh.Trimesh."""

    def __init__(self) -> None:
        self.vertices = VERTICES
        self.faces = FACES


class Cells:
    """Like meshio.Mesh."""

    def __init__(self) -> None:
        self.points = VERTICES
        self.cells_dict = {"triangle": FACES, "line": numpy.array([[0, 1]])}


@pytest.mark.parametrize(
    "mesh", [(VERTICES, FACES), [VERTICES.tolist(), FACES.tolist()], Mesh(VERTICES, FACES), Meshed(), Cells()]
)
def test_arrays_are_sent_as_glb(mesh: Any) -> None:
    positions, triangles = arrays_in(load_mesh(mesh).data)
    assert numpy.array_equal(positions, VERTICES.astype("f4"))
    assert numpy.array_equal(triangles, FACES)


def test_colors_of_trimesh_and_normals_of_open3d_are_taken() -> None:
    colors = numpy.array([[255, 0, 0, 255]] * len(VERTICES), numpy.uint8)
    visual = types.SimpleNamespace(kind="vertex", vertex_colors=colors)
    colored: Any = arrays_of(types.SimpleNamespace(vertices=VERTICES, faces=FACES, visual=visual))
    assert colored.colors is colors
    like_open3d = types.SimpleNamespace(
        vertices=VERTICES,
        triangles=FACES,
        has_vertex_colors=lambda: False,
        has_vertex_normals=lambda: True,
        vertex_normals=VERTICES,
    )
    taken: Any = arrays_of(like_open3d)
    assert taken.colors is None and numpy.array_equal(taken.normals, VERTICES) and numpy.array_equal(taken.faces, FACES)


def test_vtk_polygons_are_sent_as_ply_and_normals_are_kept() -> None:
    pytest.importorskip("vtkmodules")
    from vtkmodules.vtkFiltersSources import vtkCubeSource

    source = vtkCubeSource()
    source.Update()
    data = bytes(load_mesh(source.GetOutput()).data)
    head, _, body = data.partition(b"end_header\n")
    assert b"element vertex 24" in head and b"element face 6" in head and b"property float nz" in head
    assert len(body) == 24 * (3 * 8 + 3 * 4) + 6 * 5 * 4


def test_quads_are_split_along_one_diagonal() -> None:
    _, triangles = arrays_in(load_mesh(shapes.cube()).data)
    assert triangles.shape == (12, 3)
    assert triangles[0].tolist() == [0, 2, 3] and triangles[1].tolist() == [0, 3, 1]


def test_torch_tensors_are_taken() -> None:
    torch = pytest.importorskip("torch")
    positions, triangles = arrays_in(load_mesh((torch.tensor(VERTICES, requires_grad=True), torch.tensor(FACES))).data)
    assert len(positions) == 4 and len(triangles) == 4


def test_meshio_meshes_are_taken() -> None:
    meshio = pytest.importorskip("meshio")
    positions, _ = arrays_in(load_mesh(meshio.Mesh(VERTICES, [("triangle", FACES)])).data)
    assert len(positions) == 4


@pytest.mark.parametrize(
    "vertices, faces, field",
    [
        (VERTICES, [[0, 1, 4]], "faces"),
        (VERTICES, [[0, 1, -1]], "faces"),
        (VERTICES, [[0, 1]], "faces"),
        (VERTICES, [[0.0, 1.0, 2.0]], "faces"),
        ([[0, 0]], [[0, 0, 0]], "vertices"),
        ([[0, 0, float("nan")]], [[0, 0, 0]], "vertices"),
        ([[0, 0, 1e60]], [[0, 0, 0]], "vertices"),
    ],
)
def test_wrong_arrays_are_named(vertices: Any, faces: Any, field: str) -> None:
    with pytest.raises(InvalidMesh) as caught:
        write_glb(Mesh(vertices, faces))
    assert caught.value.field == field


def test_normals_and_colors_need_one_a_vertex() -> None:
    with pytest.raises(InvalidMesh, match="normals: 3 of them for 4 vertices"):
        write_glb(Mesh(VERTICES, FACES, normals=numpy.ones((3, 3))))


def test_other_objects_are_a_type_error() -> None:
    with pytest.raises(TypeError, match="int is no mesh"):
        load_mesh(3)
    with pytest.raises(TypeError, match="binary mode"):
        load_mesh(io.StringIO("x"))


def test_files_bytes_and_paths_are_the_same(tmp_path: pathlib.Path) -> None:
    data = write_glb(Mesh(VERTICES, FACES))
    path = tmp_path / "a.glb"
    path.write_bytes(data)
    with open(path, "rb") as file:
        forms = [data, bytearray(data), memoryview(data), path, str(path), io.BytesIO(data), file]
        assert {load_mesh(form).sha256() for form in forms} == {load_mesh(data).sha256()}
    with pytest.raises(FileNotFoundError):
        load_mesh(tmp_path / "b.glb")


def test_large_files_are_mapped(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "large.drc"
    path.write_bytes(b"DRACO" + bytes(5 << 20))
    assert bytes(load_mesh(path).data[:5]) == b"DRACO"
    assert len(load_mesh(path).data) == 5 + (5 << 20)


def write_gltf(folder: pathlib.Path, buffer_uri: str, image_uri: str = "") -> pathlib.Path:
    document, binary = read_glb(write_glb(Mesh(VERTICES, FACES)))
    document["buffers"] = [
        {"byteLength": 4, "uri": "data:;base64,AAAAAA=="},
        {"byteLength": len(binary), "uri": buffer_uri},
    ]
    for view in document["bufferViews"]:
        view["buffer"] = 1
    if image_uri:
        document["images"] = [{"uri": image_uri}]
    path = folder / "a.gltf"
    path.write_text(json.dumps(document))
    (folder / "a b.bin").write_bytes(binary)
    return path


def test_a_gltf_is_packed_with_its_files(tmp_path: pathlib.Path) -> None:
    path = write_gltf(tmp_path, "a%20b.bin", "picture.png")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG and so on")
    data = load_mesh(path).data
    document, binary = read_glb(data)
    assert "uri" not in document["buffers"][0] and document["buffers"][1]["uri"].startswith("data:")
    positions, _ = arrays_in(data)
    assert numpy.array_equal(positions, VERTICES.astype("f4"))
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    assert binary[view["byteOffset"] :][: view["byteLength"]] == b"\x89PNG and so on"
    assert document["images"][0]["mimeType"] == "image/png"


def test_a_file_is_packed_once_however_often_it_is_named(tmp_path: pathlib.Path) -> None:
    path = write_gltf(tmp_path, "a%20b.bin", "picture.png")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG" + bytes(10_000))
    document = json.loads(path.read_text())
    document["images"] = [{"uri": "picture.png"}, {"uri": "./picture.png"}] * 100
    # The last one, of all of the file, is read.
    whole = document["buffers"][1]
    (tmp_path / "a b.bin").write_bytes((tmp_path / "a b.bin").read_bytes() + bytes(10_000))
    document["buffers"] += [{**whole, "byteLength": whole["byteLength"] + i} for i in range(100)]
    document["buffers"].append({"uri": "a%20b.bin"})
    for view in document["bufferViews"]:
        view["buffer"] = len(document["buffers"]) - 1
    path.write_text(json.dumps(document))
    data = load_mesh(path).data
    assert len(data) < 60_000
    packed, binary = read_glb(data)
    assert len({image["bufferView"] for image in packed["images"]}) == 1
    assert len(packed["images"]) == 200 and not any("uri" in image for image in packed["images"])
    view = packed["bufferViews"][packed["images"][199]["bufferView"]]
    assert binary[view["byteOffset"] :][: view["byteLength"]] == b"\x89PNG" + bytes(10_000)
    positions, _ = arrays_in(data)
    assert numpy.array_equal(positions, VERTICES.astype("f4"))


def test_a_missing_image_stays_a_name_and_a_missing_buffer_is_an_error(tmp_path: pathlib.Path) -> None:
    document, _ = read_glb(load_mesh(write_gltf(tmp_path, "a%20b.bin", "none.png")).data)
    assert document["images"] == [{"uri": "none.png"}]
    with pytest.raises(InvalidMesh, match="buffer 1: URI 'none.bin'"):
        load_mesh(write_gltf(tmp_path, "none.bin"))


@pytest.mark.parametrize(
    "uri", ["../secret.bin", "link.bin", "/etc/passwd", "file:///etc/passwd", "..\\x", "%2e%2e/secret.bin"]
)
def test_files_outside_of_the_folder_are_refused(tmp_path: pathlib.Path, uri: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(200))
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(InvalidMesh, match="buffer 1"):
        load_mesh(write_gltf(folder, uri))


def test_files_outside_are_read_where_allowed(tmp_path: pathlib.Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    path = write_gltf(folder, "../b.bin")
    (folder / "a b.bin").rename(tmp_path / "b.bin")
    assert len(load_mesh(path, allow_outside=True).data) > 0
