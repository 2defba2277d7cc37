#!/usr/bin/env python3
"""Makes voxelpipe/_proto from the service's .proto files, with protoc.

usage: generate_stubs.py [--proto DIR] [--out DIR]

It holds the descriptors of the files, a module for each, whose names voxelpipe/_messages.py makes, and their types.
"""
import argparse
import pathlib
import re
import shutil
import subprocess
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
PROTOS = (
    "google/rpc/status.proto",
    "google/rpc/error_details.proto",
    "voxelpipe/v1/types.proto",
    "voxelpipe/v1/error.proto",
    "voxelpipe/v1/request.proto",
    "voxelpipe/v1/result.proto",
    "voxelpipe/v1/mesh.proto",
    "voxelpipe/v1/server_info.proto",
    "voxelpipe/v1/voxelization_service.proto",
)
PACKAGE = "voxelpipe._proto"
MODULE = """from voxelpipe._messages import names_of

globals().update(names_of("{}"))
"""


def rewritten(text: str) -> str:
    """Types with imports from this package."""
    text = re.sub(r"^from (google\.rpc|voxelpipe\.v1) import", rf"from {PACKAGE}.\1 import", text, flags=re.M)
    return re.sub(r"^import (google\.rpc|voxelpipe\.v1)\.", rf"import {PACKAGE}.\1.", text, flags=re.M)


def generate(proto: pathlib.Path, out: pathlib.Path) -> None:
    """Replaces the package `out`. In: the folder that imports in .proto files start from."""
    with tempfile.TemporaryDirectory() as folder:
        made = pathlib.Path(folder)
        files = made / "files"
        outputs = [f"--descriptor_set_out={files}", "--include_imports", f"--pyi_out={made}"]
        subprocess.run(["protoc", f"-I{proto}", *outputs, *PROTOS], check=True)
        shutil.rmtree(out, ignore_errors=True)
        for name in PROTOS:
            types = pathlib.Path(name.replace(".proto", "_pb2.pyi"))
            (out / types).parent.mkdir(parents=True, exist_ok=True)
            (out / types).write_text(rewritten((made / types).read_text()))
            (out / types).with_suffix(".py").write_text(MODULE.format(name))
        (out / "_files.py").write_text(f"FILES = {files.read_bytes()!r}\n")
        for package in [out, *(path for path in out.rglob("*") if path.is_dir())]:
            (package / "__init__.py").write_text("")


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--proto", type=pathlib.Path, default=HERE.parents[1] / "proto")
    parser.add_argument("--out", type=pathlib.Path, default=HERE / "voxelpipe" / "_proto")
    arguments = parser.parse_args()
    generate(arguments.proto, arguments.out)


if __name__ == "__main__":
    main()
