"""Runs the Python blocks of README.md as they stand, with the meshes and the server that they take for granted. Those
of "Recipes for parts" are run by tests/recipes.

usage: guide.py README     in a folder with bunny.glb (make_ball.py), key.pem and cert.pem (of 127.0.0.1)
"""
from __future__ import annotations

import asyncio
import contextlib
import json
import os
import pathlib
import re
import struct
import subprocess
import sys
import textwrap
from typing import Any, Iterator

import numpy

import voxelpipe
from voxelpipe.local_server import find_program

TOKEN = "sixteen-characters-and-more"


def animated(glb: bytes) -> bytes:
    """The file with an animation: its first node moves by 1 along x within a second."""
    (length,) = struct.unpack_from("<I", glb, 12)
    file, data = json.loads(glb[20 : 20 + length]), glb[28 + length :]
    times, places = len(file["accessors"]), len(file["accessors"]) + 1
    for values, kind in (((0, 1), "SCALAR"), ((0, 0, 0, 1, 0, 0), "VEC3")):
        view = len(file["bufferViews"])
        file["accessors"].append({"bufferView": view, "componentType": 5126, "count": 2, "type": kind})
        file["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": 4 * len(values)})
        data += struct.pack(f"<{len(values)}f", *values)
    file["accessors"][times] |= {"min": [0], "max": [1]}
    file["buffers"][0]["byteLength"] = len(data)
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    file["animations"] = [{"channels": [channel], "samplers": [{"input": times, "output": places}]}]
    text = json.dumps(file).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(data), len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(data), 0x004E4942) + data


@contextlib.contextmanager
def far(*options: str) -> Iterator[str]:
    """A server; its address."""
    command = [find_program(), "--listen", "127.0.0.1:0", "--lame-duck-ms", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        try:
            yield address
        finally:
            process.terminate()


def main(readme: pathlib.Path) -> None:
    before, _, after = readme.read_text("utf-8").partition("\n## Recipes for parts\n")
    guide = before + after.partition("\n## ")[2]
    blocks = re.findall(r"^```py(?:thon)?\n(.*?)^```", guide, re.M | re.S)
    in_process, on_device, servers, together = blocks
    called, local, asynchronous = servers.split("\n\n")
    names: dict[str, Any] = {"voxelpipe": voxelpipe, "paths": ["bunny.glb"] * 5}
    vertices = 252  # of make_ball.py
    names["positions"] = numpy.random.default_rng(1).random((10, vertices, 3), numpy.float32)
    pathlib.Path("animated.glb").write_bytes(animated(pathlib.Path("bunny.glb").read_bytes()))
    pathlib.Path("token").write_text(TOKEN)
    pathlib.Path("tokens.json").write_text(f'{{"clients": [{{"name": "me", "role": "user", "token": "{TOKEN}"}}]}}')

    exec(in_process, names)
    exec(together, names)
    os.environ["GRPC_DEFAULT_SSL_ROOTS_FILE_PATH"] = "cert.pem"
    with far("--tls-cert", "cert.pem", "--tls-key", "key.pem", "--token-file", "tokens.json") as address:
        exec(called.replace("far:50051", address), names)
    exec(local, names)
    with far() as address:
        exec("async def run():\n" + textwrap.indent(asynchronous, "    ").replace("far:50051", address), names)
        asyncio.run(names["run"]())
    try:
        exec(on_device, names)
    except voxelpipe.VoxelpipeError as error:  # where there is no driver
        print(f"results on the GPU: {error}")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
