"""The lies of test_results.py told to the command line, which reads results by the C++ client."""
from __future__ import annotations

import pathlib
import subprocess

import pytest

from voxelpipe._mesh.glb import Mesh, write_glb

from .. import shapes
from .liar import Liar, honest, tell, tell_whole
from .raw_liar import raw_liar
from .test_results import DISORDER, LATE, LIES
from .test_raw import ANSWERS

# Each is read by code of its own: as it arrives, or as a whole in which voxels and fragments are looked up.
FILES = {"dense": ["a.npz", "a.ply"], "sparse": ["a.npz", "a.ply", "a.html"], "buckets": ["a.npz", "a.ply"]}


def run(cli: str, address: str, folder: pathlib.Path, kind: str, file: str) -> "subprocess.CompletedProcess[str]":
    """Runs voxelize in a folder."""
    (folder / "cube.glb").write_bytes(write_glb(Mesh(*shapes.cube())))
    command = [cli, "voxelize", "cube.glb", "-o", file, "--server", address, "--resolution", "4", "--result", kind]
    command += ["--target", "u32:replace:shader=triangle_id", "--progress", "json"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("kind, file", [(kind, file) for kind, files in FILES.items() for file in files])
def test_the_honest_results_are_taken(
    liar: tuple[Liar, str], cli: str, tmp_path: pathlib.Path, kind: str, file: str
) -> None:
    for told in (tell, tell_whole):
        result = honest(kind)
        result.hashed()
        told(liar[0], result)
        ran = run(cli, liar[1], tmp_path, kind, file)
        assert ran.returncode == 0 and (tmp_path / file).exists(), ran.stderr


@pytest.mark.parametrize("lie", [*LIES, *DISORDER, *LATE])
def test_lies_are_errors_of_the_command_line(
    liar: tuple[Liar, str], cli: str, tmp_path: pathlib.Path, lie: str
) -> None:
    change, kind = LIES[lie][:2] if lie in LIES else ({**DISORDER, **LATE}[lie][0], "dense")
    result = honest(kind)
    change(result)
    result.hashed()
    for number, file in enumerate(FILES[kind]):
        (tell_whole if number == 0 and lie in LIES else tell)(liar[0], result)
        ran = run(cli, liar[1], tmp_path, kind, file)
        assert ran.returncode == 1 and "the server's " in ran.stderr, (ran.returncode, ran.stderr)
        assert not (tmp_path / file).exists()


@pytest.mark.parametrize("answer", ANSWERS)
def test_broken_calls_are_errors_of_the_command_line(cli: str, tmp_path: pathlib.Path, answer: str) -> None:
    with raw_liar(*ANSWERS[answer]) as address:
        ran = run(cli, address, tmp_path, "dense", "a.npz")
    assert ran.returncode == 1 and not (tmp_path / "a.npz").exists(), (ran.returncode, ran.stderr)
