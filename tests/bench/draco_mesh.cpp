// draco_mesh FILE.drc [TRIANGLES]: a closed, bumpy torus of about so many triangles (default 100,000), as Draco's
// encoder writes it by default: edgebreaker, positions of 14 bits.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numbers>

#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

namespace {

draco::Vector3f Point(int u, int v, int around, int across) {
  const double a = 2 * std::numbers::pi * (u % around) / around, b = 2 * std::numbers::pi * (v % across) / across;
  const double r = 0.4 + 0.03 * std::sin(9 * a) * std::cos(7 * b);
  return draco::Vector3f(float((1 + r * std::cos(b)) * std::cos(a)), float(r * std::sin(b)),
                         float((1 + r * std::cos(b)) * std::sin(a)));
}

}  // namespace

int main(int argc, char** argv) {
  const int triangles = argc > 2 ? std::atoi(argv[2]) : 100'000;
  if (argc < 2 || argc > 3 || triangles < 50) {
    std::fprintf(stderr, "usage: draco_mesh FILE.drc [TRIANGLES, at least 50]\n");
    return 2;
  }
  const int across = std::max(5, int(std::sqrt(triangles / 2 / 1.25))), around = triangles / 2 / across;
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(2 * around * across);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  uint32_t face = 0;
  for (int u = 0; u < around; ++u) {
    for (int v = 0; v < across; ++v) {
      const draco::Vector3f a = Point(u, v, around, across), b = Point(u + 1, v, around, across),
                            c = Point(u + 1, v + 1, around, across), d = Point(u, v + 1, around, across);
      builder.SetAttributeValuesForFace(position, draco::FaceIndex(face++), a.data(), b.data(), c.data());
      builder.SetAttributeValuesForFace(position, draco::FaceIndex(face++), a.data(), c.data(), d.data());
    }
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::Encoder encoder;
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 14);
  draco::EncoderBuffer bytes;
  if (!mesh || !encoder.EncodeMeshToBuffer(*mesh, &bytes).ok()) {
    std::fprintf(stderr, "draco_mesh: the mesh could not be encoded\n");
    return 1;
  }
  std::FILE* const file = std::fopen(argv[1], "wb");
  const bool written = file != nullptr && std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
  if (file == nullptr || std::fclose(file) != 0 || !written) {
    std::fprintf(stderr, "draco_mesh: %s cannot be written\n", argv[1]);
    return 1;
  }
  std::printf("%u triangles, %zu bytes\n", face, bytes.size());
  return 0;
}
