#!/usr/bin/env bash
# Makes the wheels voxelpipe and voxelpipe-core; the latter with all that it needs inside, for other Linux systems.
# usage: make_wheels.sh DIST CORE_PACKAGE PROGRAM...     (make wheels)
#   CORE_PACKAGE, PROGRAM  what CMake built: the folder of the compiled package, voxelpiped, voxelpipe
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
dist="$(realpath -m "$1")"
package="$2"
shift 2
python() { bash "$here/../../tests/support/python.sh" "$@"; }
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
# Copies: setuptools writes beside its sources.
mkdir -p "$work/source/client"
ln -s "$here/../../proto" "$work/source/proto"
cp -r "$here" "$work/source/client/python"
cp -r "$package" "$work/core"
python "$here/core/bundle.py" "$work/core" "$@"
rm -f "$dist"/voxelpipe-*.whl "$dist"/voxelpipe_core-*.whl
for folder in "$work/source/client/python" "$work/core"; do
  python -m pip -q wheel --no-index --no-build-isolation --no-deps -w "$dist" "$folder"
done
