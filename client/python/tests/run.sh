#!/usr/bin/env bash
# Runs the tests of the Python package on stubs that are made anew.
# usage: run.sh VOXELPIPED VOXELPIPE WORK_FOLDER [PYTEST_ARGUMENT...]
# Exit status: pytest's; 77 with the reason if a Python package that all tests need is missing.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
export VOXELPIPE_VOXELPIPED="$1" VOXELPIPE_CLI="$2"
export PYTHONPATH="${VOXELPIPE_CORE_PACKAGE:-}${PYTHONPATH:+:$PYTHONPATH}"  # voxelpipe_core, if it was built
work="$3"
shift 3
python="$here/../../tests/support/python.sh"
for module in numpy grpc google.protobuf pytest; do
  if ! bash "$python" -c "import $module" 2>/dev/null; then
    echo "skipped: Python has no module $module; docker/packages-python.txt lists the packages"
    exit 77
  fi
done
# A copy, so that the source tree stays as it is and several builds can test at the same time.
tree="$work/tree"
rm -rf "$tree"
mkdir -p "$tree/client/python"
ln -s "$here/../../proto" "$here/../../tests" "$tree/"  # its tests read a table that the core reads too
cd "$here"
cp -r generate_stubs.py setup.py pyproject.toml README.md voxelpipe tests examples bench "$tree/client/python/"
cd "$tree/client/python"
bash "$python" generate_stubs.py
export VOXELPIPE_MYPY_CACHE="$work/mypy"
exec bash "$python" -m pytest -q -p no:cacheprovider tests "$@"
