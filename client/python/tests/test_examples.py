"""The examples as they stand, on meshes made by code; the notebook is executed. Types: test_package.py."""
from __future__ import annotations

import json
import os
import pathlib
import signal
import subprocess
import sys

import numpy
import pytest

import voxelpipe
from voxelpipe import LocalServer
from voxelpipe._mesh.glb import write_glb

from . import shapes

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
EXAMPLES = PACKAGE / "examples"


def run(name: str, *arguments: object, status: int = 0) -> list[str]:
    """The lines that an example prints. The variable VOXELPIPE_SERVER names the server of these tests."""
    path = os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")])
    ran = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=240,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert ran.returncode == status, ran.stdout + ran.stderr
    return ran.stdout.splitlines()


def write_boxes(folder: pathlib.Path, count: int) -> list[pathlib.Path]:
    """GLB files box0, box1, ... of the size (1, 1, 1 + i), red."""
    vertices, faces = shapes.cube()
    paths = []
    for i in range(count):
        red = numpy.tile(numpy.array([[255, 0, 0, 255]], numpy.uint8), (len(vertices), 1))
        paths.append(folder / f"box{i}.glb")
        paths[-1].write_bytes(write_glb(voxelpipe.Mesh(vertices * (1, 1, 1 + i), faces, colors=red)))
    return paths


def test_colors_of_many_meshes(server: LocalServer, tmp_path: pathlib.Path) -> None:
    paths = write_boxes(tmp_path, 3)
    (tmp_path / "bad.glb").write_bytes(b"nonsense")
    (tmp_path / "more").mkdir()
    again = tmp_path / "more" / "box0.glb"
    again.write_bytes(paths[0].read_bytes())
    lines = run("glb_to_colors.py", tmp_path / "out", *paths, tmp_path / "bad.glb", again, "--resolution", 16, status=1)
    assert len(lines) == 4 and (tmp_path / "out" / "box0-2.npz").exists()
    for i in range(3):
        with numpy.load(tmp_path / "out" / f"box{i}.npz") as arrays:
            points, colors = arrays["points"], arrays["colors"]
        half = (1 + i) / 16 / 2
        assert (points > -half).all() and (points < numpy.array([1, 1, 1 + i]) + half).all()
        assert (colors == (255, 0, 0, 255)).all() and len(colors) == len(points)


def test_a_rotating_part(server: LocalServer, tmp_path: pathlib.Path) -> None:
    # The box 1 x 1 x 4 turns about y: its volume is 4, and its far corner is sqrt(0.25 + 4) from the axis.
    lines = run("rotating_part.py", write_boxes(tmp_path, 4)[3], "--steps", 5, "--resolution", 96)
    assert len(lines) == 5
    cell = (numpy.sqrt(1 + 1 + 16) / 96) ** 3
    for step, line in enumerate(lines):
        words = line.split()
        solid, changed, speed = int(words[2]), int(words[4]), float(words[8])
        assert solid * cell == pytest.approx(4, rel=0.1)
        assert (changed > 0) == (step > 0)
        assert 0.9 * 2 * numpy.pi * numpy.sqrt(4.25) < speed <= 2 * numpy.pi * numpy.sqrt(4.25)


def test_a_training_set_goes_on_where_it_ended(server: LocalServer, tmp_path: pathlib.Path) -> None:
    meshes, out = tmp_path / "meshes", tmp_path / "out"
    (meshes / "below").mkdir(parents=True)
    write_boxes(meshes, 5)
    (meshes / "box4.glb").rename(meshes / "below" / "box4.glb")
    (meshes / "box0.glb").write_bytes(b"nonsense")
    options = (meshes, out, "--resolution", 12, "--shard", 2)
    assert len(run("training_set.py", *options)) == 3
    assert sorted(path.name for path in out.iterdir()) == [
        "failed-00000.json",
        *(f"shard-0000{i}.npz" for i in range(3)),
    ]
    assert "box0.glb" in json.loads((out / "failed-00000.json").read_text())
    with numpy.load(out / "shard-00001.npz") as shard:
        assert shard["names"].tolist() == ["box1.glb", "box2.glb"]
        cubes = numpy.unpackbits(shard["bits"], axis=1, count=12**3, bitorder="little").reshape(-1, 12, 12, 12)
    assert cubes[0].any(axis=(1, 2)).all() and cubes[0].sum() < 12**3
    (out / "shard-00001.npz").unlink()
    assert [line.endswith("is there") for line in run("training_set.py", *options)] == [True, False, True]
    with numpy.load(out / "shard-00000.npz") as shard:
        assert shard["names"].tolist() == ["below/box4.glb"]
    run("training_set.py", tmp_path / "out", tmp_path / "none", status=2)


def test_dask_with_processes(server: LocalServer, tmp_path: pathlib.Path) -> None:
    pytest.importorskip("distributed")
    lines = run("dask_processes.py", *write_boxes(tmp_path, 4), "--resolution", 96)
    assert [float(line.rpartition(" ")[2]) for line in lines] == pytest.approx([1, 2, 3, 4], rel=0.01)


def dask_workers(process: int) -> list[int]:
    """The processes of the workers that this process has started."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and b"spawn_main" in (entry / "cmdline").read_bytes():
                parent = (entry / "stat").read_text().rpartition(")")[2].split()[1]
                found += [int(entry.name)] if int(parent) == process else []
        except OSError:
            continue  # it has ended
    return found


def test_dask_shards_are_the_same_if_a_worker_is_killed(server: LocalServer, tmp_path: pathlib.Path) -> None:
    pytest.importorskip("distributed")
    folder, out = tmp_path / "meshes", tmp_path / "out"
    folder.mkdir()
    write_boxes(folder, 40)
    (folder / "bad.glb").write_bytes(b"nonsense")
    options = ["--resolution", 96, "--shard", 4]
    last = run("dask_shards.py", folder, *options)[-1]
    assert last.startswith("40 meshes, 1 failed, ")
    command = [sys.executable, EXAMPLES / "dask_shards.py", folder, out, *options]
    path = os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")])
    with subprocess.Popen(
        [str(word) for word in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    ) as ran:
        assert ran.stdout is not None
        assert ran.stdout.readline().startswith("1 of 11 shards")
        workers = dask_workers(ran.pid)
        assert len(workers) == 2
        os.kill(workers[0], signal.SIGKILL)
        lines = ran.stdout.read().splitlines()
    assert ran.returncode == 0 and lines[-1].split()[-1] == last.split()[-1]
    files = {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".part"}
    assert len(files) == 11
    (out / "shard-00003.npz").unlink()
    assert run("dask_shards.py", folder, out, *options)[-1].split()[-1] == last.split()[-1]
    assert files == {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".part"}


def test_a_torch_data_loader_forks_its_workers(server: LocalServer, tmp_path: pathlib.Path) -> None:
    pytest.importorskip("torch")
    lines = run("torch_loader.py", *write_boxes(tmp_path, 4), "--resolution", 16)
    assert len(lines) == 4 and lines[0].removeprefix("epoch 0") == lines[2].removeprefix("epoch 1")
    assert lines[0].startswith("epoch 0: meshes [0, 1], (2, 1, 16, 16, 16)")


def test_the_notebook_runs(server: LocalServer, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(EXAMPLES / "first_steps.ipynb", as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        assert cell.cell_type != "code" or (cell.execution_count is None and not cell.outputs), "has outputs"
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")]))
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(EXAMPLES)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert any("2.4" in output.get("data", {}).get("text/plain", "") for output in outputs)
    assert any("the largest that fits" in output.get("text", "") for output in outputs)
