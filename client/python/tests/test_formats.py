"""Meshes in STL, PLY, OFF, OBJ and 3MF: units, and the files that an OBJ file names."""
from __future__ import annotations

import base64
import hashlib
import json
import pathlib
import pickle
import subprocess
import urllib.parse
from typing import get_args

import numpy
import pytest

import voxelpipe
from voxelpipe import InvalidMesh, InvalidRequest, load_mesh
from voxelpipe.names import LengthUnit, MeshFormat

OBJ = "v 0 0 0\nv 20 0 0\nv 0 20 0\nv 0 0 20\nvt 0.5 0.5\nf 1/1 3/1 2/1\nf 1/1 2/1 4/1\nf 1/1 4/1 3/1\nf 2/1 3/1 4/1\n"
RED_PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR42mP4z8AAAAMBAQD3A0FDAAAAAElFTkSuQmCC"
)


def write_model(folder: pathlib.Path, library: str = "parts/all.mtl") -> pathlib.Path:
    """An OBJ file with a material whose texture is red, in a folder of its own."""
    (folder / "parts").mkdir(parents=True)
    (folder / "parts/my wood.png").write_bytes(RED_PNG)
    (folder / "parts/all.mtl").write_text("newmtl a\nmap_Kd -s 1 1 1 my wood.png\nnewmtl b\r\nmap_Ke .\\my wood.png\n")
    path = folder / "model.obj"
    path.write_text(f"mtllib {library}\r\nusemtl a\n{OBJ}")
    return path


def test_an_obj_takes_its_libraries_and_textures_along(tmp_path: pathlib.Path) -> None:
    data = bytes(load_mesh(write_model(tmp_path / "m")).data)
    first, _, rest = data.partition(b"\r\n")
    assert first.startswith(b"mtllib data:model/mtl;name=parts/all.mtl,")
    library = urllib.parse.unquote_to_bytes(first.partition(b",")[2]).decode()
    assert library.count(base64.b64encode(RED_PNG).decode()) == 1
    assert "map_Kd -s 1 1 1 data:image/png;name=my%20wood.png;base64," in library
    assert library.endswith("\nnewmtl b\r\nmap_Ke my wood.png\n")
    assert rest.decode() == f"usemtl a\n{OBJ}"


def test_a_library_is_packed_once_however_often_it_is_named(tmp_path: pathlib.Path) -> None:
    path = write_model(tmp_path / "m")
    (tmp_path / "m/b.mtl").write_text("newmtl b\n")
    path.write_text("mtllib parts/all.mtl\nmtllib b.mtl ./parts/all.mtl\nmtllib b.mtl\n" * 100 + OBJ)
    data = bytes(load_mesh(path).data)
    assert data.count(b"data:model/mtl") == 2
    assert data.endswith(b"mtllib\n" + OBJ.encode())


@pytest.mark.parametrize("library", ["none.mtl", "/etc/passwd", "C:\\all.mtl", "http://example.org/all.mtl"])
def test_a_missing_library_stays_a_name(tmp_path: pathlib.Path, library: str) -> None:
    path = write_model(tmp_path / "m", library)
    assert bytes(load_mesh(path).data) == path.read_bytes()


def test_libraries_outside_of_the_folder_are_refused(tmp_path: pathlib.Path) -> None:
    (tmp_path / "secret.mtl").write_text("newmtl a\n")
    path = write_model(tmp_path / "m", "../secret.mtl")
    with pytest.raises(InvalidMesh, match="outside of the OBJ file's folder"):
        load_mesh(path)
    assert b"mtllib data:" in load_mesh(path, allow_outside=True).data.tobytes()


def test_unit_and_format_are_part_of_the_name() -> None:
    plain = load_mesh(OBJ.encode())
    scaled = load_mesh(plain, unit="mm")
    name = f"meshes/{hashlib.sha256(OBJ.encode()).hexdigest()}"
    assert plain.stored_name() == name and scaled.stored_name() == f"{name}-mm"
    assert load_mesh(OBJ.encode(), format="obj").stored_name() == f"{name}-obj"
    assert load_mesh(OBJ.encode(), format="stl", unit="in").stored_name() == f"{name}-in-stl"
    empty = f"meshes/{hashlib.sha256().hexdigest()}"
    for format in get_args(MeshFormat):
        suffix = {"auto": "", "draco": "-drc"}.get(format, f"-{format}")
        assert load_mesh(b"", format=format).stored_name() == empty + suffix
    for unit in get_args(LengthUnit):
        assert load_mesh(b"", unit=unit).stored_name() == f"{empty}-{unit}"


def test_arrays_have_the_name_of_their_file(tmp_path: pathlib.Path) -> None:
    arrays = load_mesh((numpy.eye(3), [[0, 1, 2]]))
    (tmp_path / "a.glb").write_bytes(arrays.data)
    assert arrays.stored_name() == load_mesh(tmp_path / "a.glb").stored_name() == f"meshes/{arrays.sha256()}"
    packed = load_mesh(write_model(tmp_path / "m"))
    assert packed.stored_name() == load_mesh(bytes(packed.data)).stored_name() == f"meshes/{packed.sha256()}"


def test_other_units_are_refused() -> None:
    plain = load_mesh(OBJ.encode(), format="obj")
    scaled = load_mesh(plain, unit="mm")
    with pytest.raises(ValueError, match="is none of mm, cm, m, in"):
        load_mesh(plain, unit="km")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="was loaded with the unit mm"):
        load_mesh(scaled, unit="cm")


def test_the_server_scales_to_metres(client: voxelpipe.Client) -> None:
    mesh = load_mesh(OBJ.encode(), unit="mm")
    grid = client.voxelize(mesh, resolution=16)
    assert grid.voxel_size[0] == 20 * 0.001 / 16
    handle = client.upload(mesh)
    assert handle.name == mesh.stored_name()
    again = pickle.loads(pickle.dumps(handle))
    assert client.voxelize(again, resolution=16).sha256 == grid.sha256
    with pytest.raises(InvalidMesh, match="OBJ: line 1: a vertex: 'x' is no number"):
        client.voxelize(b"v x 0 0\n")


def test_the_textures_are_those_of_the_command_line(client: voxelpipe.Client, cli: str, tmp_path: pathlib.Path) -> None:
    path = write_model(tmp_path / "m")
    grid = client.voxelize(path, resolution=16, targets="base_color:u8x3:replace")
    command = [cli, "voxelize", str(path), "--resolution", "16", "--target", "u8x3:replace:shader=base_color", "--json"]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    assert json.loads(printed)["hash"] == grid.sha256
    assert numpy.array_equal(numpy.unique(grid.array.reshape(-1, 3), axis=0), [[0, 0, 0], [255, 0, 0]])


def test_a_glb_refuses_a_unit(client: voxelpipe.Client) -> None:
    mesh = load_mesh((numpy.eye(3), [[0, 1, 2]]), unit="mm")
    with pytest.raises((InvalidMesh, InvalidRequest), match="unit of its own"):
        client.voxelize(mesh)
