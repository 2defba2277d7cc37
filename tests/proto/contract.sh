#!/usr/bin/env bash
# usage: contract.sh PROTO_DIR WORK_DIR
# The style of the messages (buf lint), and that no client of the last release breaks (buf breaking against
# released.binpb). Takes buf from npm. Exit 77 with the reason if there is no npm, or its registry cannot be reached.
set -euo pipefail

proto=$(realpath "$1")
mkdir -p "$2"
work=$(realpath "$2")
buf=$work/node_modules/.bin/buf
if [ ! -x "$buf" ]; then
  command -v npm >/dev/null || { echo "skipped: npm is not installed"; exit 77; }
  timeout 180 npm install --prefix "$work" --no-audit --no-fund --silent @bufbuild/buf@1.75.0 ||
    { echo "skipped: npm cannot install @bufbuild/buf"; exit 77; }
fi
cd "$proto"
"$buf" lint
"$buf" breaking --against released.binpb

# The comparison must see a change that breaks clients.
cp -r "$proto" "$work/changed"
trap 'rm -rf "$work/changed"' EXIT
cd "$work/changed"
sed -i 's/bytes piece = 2;/bytes piece = 9;/' voxelpipe/v1/voxelization_service.proto
if "$buf" breaking --against released.binpb >/dev/null; then
  echo "a moved field is not found" >&2
  exit 1
fi
