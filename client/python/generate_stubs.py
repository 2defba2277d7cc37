#!/usr/bin/env python3
"""Makes voxelpipe/_proto from the service's .proto files, with protoc.

usage: generate_stubs.py [--proto DIR] [--out DIR]

The modules live in the package voxelpipe._proto and their messages in a descriptor pool of its own. So they clash
neither with a program's own stubs of this service nor with its googleapis packages.
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
POOL = '''"""The descriptor pool of this package's messages: apart from the process's default one."""
from google.protobuf import any_pb2, descriptor_pool, duration_pb2, message_factory

POOL = descriptor_pool.DescriptorPool()
for _file in (any_pb2, duration_pb2):
    POOL.AddSerializedFile(_file.DESCRIPTOR.serialized_pb)
# The classes of the messages that others contain; protobuf 4.22 and later make them by another function.
for _name in ("google.protobuf.Any", "google.protobuf.Duration"):
    _type = POOL.FindMessageTypeByName(_name)
    if hasattr(message_factory, "GetMessageClass"):
        message_factory.GetMessageClass(_type)
    else:
        message_factory.MessageFactory(POOL).GetPrototype(_type)
'''


def rewritten(text: str) -> str:
    """The module with imports from this package, and with its pool."""
    text = re.sub(r"^from (google\.rpc|voxelpipe\.v1) import", rf"from {PACKAGE}.\1 import", text, flags=re.M)
    text = re.sub(r"^import (google\.rpc|voxelpipe\.v1)\.", rf"import {PACKAGE}.\1.", text, flags=re.M)
    return text.replace("_descriptor_pool.Default()", "_pool.POOL").replace(
        "from google.protobuf import descriptor_pool as _descriptor_pool", f"from {PACKAGE} import _pool"
    )


def generate(proto: pathlib.Path, out: pathlib.Path) -> None:
    """Replaces the package `out`. In: the folder that imports in .proto files start from."""
    with tempfile.TemporaryDirectory() as made:
        arguments = ["protoc", f"-I{proto}", f"--python_out={made}", f"--pyi_out={made}", *PROTOS]
        subprocess.run(arguments, check=True)
        shutil.rmtree(out, ignore_errors=True)
        for source in sorted(pathlib.Path(made).rglob("*.py*")):
            target = out / source.relative_to(made)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(rewritten(source.read_text()))
        (out / "_pool.py").write_text(POOL)
        for folder in [out, *(path for path in out.rglob("*") if path.is_dir())]:
            (folder / "__init__.py").write_text("")


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--proto", type=pathlib.Path, default=HERE.parents[1] / "proto")
    parser.add_argument("--out", type=pathlib.Path, default=HERE / "voxelpipe" / "_proto")
    arguments = parser.parse_args()
    generate(arguments.proto, arguments.out)


if __name__ == "__main__":
    main()
