"""Packs the module that CMake has built (target voxelpipe_core_module) into a wheel of this machine's kind."""
import setuptools


class _Binary(setuptools.Distribution):
    """A package with compiled code in it, though not compiled here."""

    def has_ext_modules(self) -> bool:
        return True


setuptools.setup(distclass=_Binary)
