// Voxelizes a mesh of one's own arrays in this process: a tetrahedron, filled, as text, layer by layer.
#include <voxelpipe/mesh/health/check_mesh.h>
#include <voxelpipe/pipeline/voxelize.h>

#include <iostream>

int main() {
  voxelpipe::TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  // Triangles with attributes or a material of their own are a part of their own; these are one part without any.
  mesh.parts.resize(1);
  mesh.parts[0].triangle_count = mesh.triangles.size();
  mesh.parts[0].vertex_count = mesh.positions.size();
  // Voxelize relies on a valid mesh; this names what is wrong, such as an index beyond the vertices.
  if (const auto valid = voxelpipe::CheckMesh(mesh); !valid.ok()) return std::cerr << valid.message() << "\n", 1;

  voxelpipe::VoxelizeRequest request;
  request.grid.resolution = 6;
  request.coverage = voxelpipe::Coverage::kNone;
  request.fill = voxelpipe::Fill::kParity;
  const auto result = voxelpipe::Voxelize(mesh, request, {});
  if (!result.ok()) return std::cerr << result.status().message() << "\n", 1;
  const auto& dims = result->grid.dims;
  const auto bits = result->targets[0].bytes();  // bit n is voxel n = i + nx * (j + ny * k)
  for (int64_t n = 0; n < dims[0] * dims[1] * dims[2]; ++n) {
    std::cout << ((bits[size_t(n / 8)] >> (n % 8) & 1) != 0 ? '#' : '.');
    if ((n + 1) % dims[0] == 0) std::cout << "\n";
    if ((n + 1) % (dims[0] * dims[1]) == 0) std::cout << "\n";
  }
  return 0;
}
