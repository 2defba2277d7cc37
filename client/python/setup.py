"""Makes the stubs of the service, if the .proto files are there, and then the wheel that pyproject.toml describes."""
import pathlib
import sys

import setuptools

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import generate_stubs  # noqa: E402

PROTO = HERE.parents[1] / "proto"
if PROTO.is_dir():
    generate_stubs.generate(PROTO, HERE / "voxelpipe" / "_proto")
# SPDX: setuptools 77 and later take an expression (PEP 639); the pyproject.toml of Debian 12's 66 a table alone.
EXPRESSION = int(setuptools.__version__.partition(".")[0]) >= 77
setuptools.setup(**{"license_expression" if EXPRESSION else "license": "Apache-2.0"})
