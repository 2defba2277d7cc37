"""Packs the module that CMake has built (target voxelpipe_core_module) into a wheel of this machine's kind."""
import os
import pathlib
import platform

import setuptools


class _Binary(setuptools.Distribution):
    """A package with compiled code in it, though not compiled here."""

    def has_ext_modules(self) -> bool:
        return True


options = {}
if pathlib.Path("voxelpipe_core", "libs").is_dir():  # bundle.py was here: any Linux of this glibc or a later one
    glibc = os.confstr("CS_GNU_LIBC_VERSION").split()[1].replace(".", "_")
    options["bdist_wheel"] = {"plat_name": f"manylinux_{glibc}_{platform.machine()}"}
# SPDX: setuptools 77 and later take an expression (PEP 639); the pyproject.toml of Debian 12's 66 a table alone.
EXPRESSION = int(setuptools.__version__.partition(".")[0]) >= 77
setuptools.setup(
    distclass=_Binary, options=options, **{"license_expression" if EXPRESSION else "license": "Apache-2.0"}
)
