#!/usr/bin/env bash
# Installs the build into a folder of its own and builds the example project (client/cpp/example) against it: with
# find_package and with pkg-config, warnings as errors, none of our compiler flags. Its programs must print what the
# command line tool reports for the same mesh.
#
# usage: package_test.sh BUILD_DIR CXX
set -euo pipefail
build_dir="$1"
cxx="$2"
source_dir="$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)"
work="$(mktemp -d)"
server_pid=
clean_up() {
  if [[ -n "$server_pid" ]]; then kill -KILL "$server_pid" 2>/dev/null || true; fi
  rm -rf "$work"
}
trap clean_up EXIT
fail() { echo "package_test: $*" >&2; exit 1; }

prefix="$work/prefix"
cmake --install "$build_dir" --prefix "$prefix" >"$work/install.log" || { cat "$work/install.log" >&2; fail "install"; }
for file in bash-completion/completions/voxelpipe man/man1/voxelpipe.1; do
  [[ -s "$prefix/share/$file" ]] || fail "share/$file is not installed"
done
grep -qx "ExecStart=$prefix/bin/voxelpiped" "$prefix/lib/systemd/system/voxelpiped.service" ||
  fail "systemd's unit does not start the installed server"
include="$prefix/include"
[[ "$(ls "$include")" == voxelpipe ]] || fail "headers outside include/voxelpipe: $(ls "$include")"
if grep -rhE '^#include "' "$include" | grep -vE '"(voxelpipe|absl)/'; then fail "includes that no user can resolve"; fi

# Each installed header compiles alone, with warnings that our own build does not ask for.
warnings=(-std=c++20 -Wall -Wextra -Wpedantic -Werror)
(cd "$include" && find voxelpipe -name '*.h' | sort | sed 's/.*/#include <&>/') >"$work/all_headers.cpp"
"$cxx" "${warnings[@]}" -fsyntax-only -I"$include" "$work/all_headers.cpp" || fail "an installed header"

cp -r "$source_dir/client/cpp/example" "$work/example"
# README's program, too.
awk '/^```cpp$/ {inside = 1; next} /^```$/ {inside = 0} inside' "$source_dir/README.md" |
  sed "s|bunny.glb|$work/mesh.gltf|; s|localhost:50051|unix:$work/socket|" >"$work/example/readme.cpp"
cat >>"$work/example/CMakeLists.txt" <<'END'
add_executable(readme readme.cpp)
target_link_libraries(readme PRIVATE voxelpipe::core voxelpipe::client)
END
cmake -S "$work/example" -B "$work/out" -DCMAKE_CXX_COMPILER="$cxx" -DCMAKE_PREFIX_PATH="$prefix" \
  -DCMAKE_CXX_FLAGS="${warnings[*]}" -DCMAKE_EXPORT_COMPILE_COMMANDS=ON >"$work/configure.log" 2>&1 ||
  { cat "$work/configure.log" >&2; fail "find_package"; }
if grep -E -- '-march|-ffp-contract|-Wshadow|-fsanitize' "$work/out/compile_commands.json"; then
  fail "a flag of ours reached the project"
fi
cmake --build "$work/out" >"$work/build.log" 2>&1 || { cat "$work/build.log" >&2; fail "the example does not build"; }

# A component that does not exist is named.
cat >"$work/wrong.cmake" <<END
cmake_minimum_required(VERSION 3.25)
project(wrong LANGUAGES CXX)
find_package(voxelpipe REQUIRED COMPONENTS serpent)
END
mkdir "$work/wrong" && mv "$work/wrong.cmake" "$work/wrong/CMakeLists.txt"
if cmake -S "$work/wrong" -B "$work/wrong/out" -DCMAKE_PREFIX_PATH="$prefix" >"$work/wrong.log" 2>&1; then
  fail "find_package accepted a component that does not exist"
fi
grep -q serpent "$work/wrong.log" || { cat "$work/wrong.log" >&2; fail "the missing component is not named"; }

export PKG_CONFIG_PATH="$prefix/lib/pkgconfig:$(echo "$prefix"/lib/*/pkgconfig)"
mkdir "$work/by_pkg_config"
for pair in in_process:core by_server:client; do
  read -ra flags <<<"$(pkg-config --cflags --libs --static "voxelpipe-${pair#*:}")"
  "$cxx" "${warnings[@]}" "$work/example/${pair%:*}.cpp" -o "$work/by_pkg_config/${pair%:*}" "${flags[@]}" ||
    fail "pkg-config voxelpipe-${pair#*:}"
done

# A tetrahedron.
cat >"$work/mesh.gltf" <<'END'
{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
 "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
 "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
               {"bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR"}],
 "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
 "buffers": [{"byteLength": 60, "uri": "data:application/octet-stream;base64,BASE64"}]}
END
bytes='\0\0\0\0\0\0\0\0\0\0\0\0\0\0\200\77\0\0\0\0\0\0\0\0\0\0\0\0\0\0\200\77\0\0\0\0\0\0\0\0\0\0\0\0\0\0\200\77'
bytes+='\0\2\1\0\1\3\0\3\2\1\2\3'
sed -i "s|BASE64|$(printf "$bytes" | base64 -w0)|" "$work/mesh.gltf"

# Of a shared build, for the programs of pkg-config.
export LD_LIBRARY_PATH="$prefix/lib:$(dirname "$(find "$prefix" -name 'libvoxelpipe_core*' | head -n 1)")"
"$prefix/bin/voxelpipe" voxelize "$work/mesh.gltf" --resolution 64 --json >"$work/cli.json" || fail "the installed CLI"
expected="$(sed -nE 's/.*"occupied": ?([0-9]+).*/\1/p' "$work/cli.json" | head -n 1)"
[[ "$expected" -gt 1000 ]] || { cat "$work/cli.json" >&2; fail "no count of occupied voxels"; }

"$prefix/bin/voxelpiped" --listen "unix:$work/socket" >"$work/server.log" 2>&1 &
server_pid=$!
disown
for _ in $(seq 200); do
  if grep -q '^listening on' "$work/server.log"; then break; fi
  sleep 0.05
done
for program in "$work"/{out,by_pkg_config}/{in_process,by_server}; do
  arguments=("$work/mesh.gltf")
  if [[ "$program" == */by_server ]]; then arguments+=("unix:$work/socket"); fi
  printed="$("$program" "${arguments[@]}")" || fail "$program failed"
  [[ "$printed" == "64x64x64: $expected voxels" ]] || fail "$program printed '$printed', not $expected voxels"
done
[[ "$("$work/out/readme")" == "$expected voxels"$'\n'"$expected voxels" ]] || fail "README's program"
# A filled tetrahedron of 6 voxels an edge: voxel (i, j, k) is inside if i + j + k < 5.
[[ "$("$work/out/from_arrays" | tr -cd '#' | wc -c)" == 35 ]] || fail "the program with arrays of its own"
"$work/out/in_process" "$work/missing.glb" 2>"$work/error.txt" && fail "a missing file was accepted"
grep -q . "$work/error.txt" || fail "a missing file without a message"
echo "package: $expected voxels in-process and by a server, with find_package and with pkg-config"
