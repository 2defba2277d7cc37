#!/usr/bin/env bash
# usage: buf_curl.sh VOXELPIPED SOURCE_DIR WORK_DIR
#
# Another implementation of gRPC-Web calls the server: `buf curl` of npm. Exit 77 with the reason if there is no npm, or
# its registry cannot be reached.
set -euo pipefail
server=$1 source=$2 work=$3
command -v npm >/dev/null || { echo "skipped: npm is not installed"; exit 77; }
mkdir -p "$work"
buf="$work/node_modules/.bin/buf"
[[ -x $buf ]] || timeout 180 npm install --prefix "$work" --no-audit --no-fund --silent @bufbuild/buf@1.75.0 ||
  { echo "skipped: npm cannot install @bufbuild/buf"; exit 77; }

"$server" --listen 127.0.0.1:0 --web-listen 127.0.0.1:0 >"$work/out" 2>"$work/log" &
trap 'kill $! 2>/dev/null' EXIT
for _ in $(seq 600); do
  url=$(sed -n 's/^web on //p' "$work/out")
  [[ -n $url ]] && break
  sleep 0.1
done
curl() { "$buf" curl --protocol grpcweb --schema "$source/proto" -d "$2" "$url/voxelpipe.v1.VoxelizationService/$1"; }

curl GetServerInfo '{}' | grep -q '"maxMessageBytes": "67108864"'
# One triangle, in a result of one message.
positions=AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA
mesh=$(tr -d '\n' <<END | base64 -w0
{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,$positions"}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]}
END
)
curl Voxelize "{\"mesh\": {\"bytes\": {\"data\": \"$mesh\"}}}" | grep -q '"contentSha256": "[0-9a-f]\{64\}"'
curl CreateMesh "{\"mesh\": {\"data\": \"$mesh\"}}" | grep -q '"name": "meshes/[0-9a-f]\{64\}"'
# An error of a stream, with its details.
name=meshes/$(printf 'a%.0s' $(seq 64))
missing=$(curl Voxelize "{\"mesh\": {\"stored\": {\"name\": \"$name\"}}}" 2>&1 || true)
grep -q '"code": "not_found"' <<<"$missing"
grep -q 'google.rpc.ResourceInfo' <<<"$missing"
