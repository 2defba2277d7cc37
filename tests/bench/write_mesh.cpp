// usage: write_mesh FILE.glb [TRIANGLES] [--masked] [--plain] [--maze]
// Writes a bumpy sphere of about so many triangles (default 1,000,000) with normals, texture coordinates and a texture
// of 1024x1024; masked: a quarter of the texture is transparent, with alpha mode MASK; plain: positions alone; maze:
// the walls of a maze of 80,000 triangles in place of the sphere.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include "bench/inputs/attributes.h"
#include "bench/inputs/mesh_files.h"
#include "bench/meshes.h"

int main(int argc, char** argv) {
  using namespace voxelpipe::bench;  // NOLINT(google-build-using-namespace): one function
  const char* path = nullptr;
  long triangles = 1'000'000;  // NOLINT(google-runtime-int): strtol's type
  bool masked = false, plain = false, maze = false;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--masked") == 0) {
      masked = true;
    } else if (std::strcmp(argv[i], "--plain") == 0) {
      plain = true;
    } else if (std::strcmp(argv[i], "--maze") == 0) {
      maze = true;
    } else if (path == nullptr) {
      path = argv[i];
    } else {
      triangles = std::strtol(argv[i], nullptr, 10);
    }
  }
  if (path == nullptr || triangles < 100) {
    std::fprintf(stderr, "usage: write_mesh FILE.glb [TRIANGLES, at least 100] [--masked] [--plain] [--maze]\n");
    return 2;
  }
  voxelpipe::TriangleMesh mesh = maze ? Maze(27) : BumpySphere(triangles);
  if (!plain && !maze) AddAttributes(mesh, {1024, masked});
  const std::vector<uint8_t> bytes = GlbBytes(mesh);
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  file.close();
  if (!file) {
    std::fprintf(stderr, "write_mesh: %s cannot be written\n", path);
    return 1;
  }
  std::printf("%s: %zu triangles, %zu bytes\n", path, mesh.triangles.size(), bytes.size());
  return 0;
}
