// Source: C. Zhang, T. Chen, "Efficient feature extraction for 2D/3D objects in mesh representation", ICIP 2001 (the
// signed volume).
#include "mesh/health/shells.h"

namespace voxelpipe {

absl::Status MeasureShells(const JobContext& job, const TriangleMesh& mesh, ShellList& list) {
  constexpr size_t kBetweenChecks = 1 << 16;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (t % kBetweenChecks == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    if (list.shell_of[t] == kNoShell) continue;
    Shell& shell = list.shells[list.shell_of[t]];
    const Vec3d& r = mesh.positions[mesh.triangles[shell.first_triangle][0]];
    Vec3d corners[3];
    for (int i = 0; i < 3; ++i) {
      const Vec3d& p = mesh.positions[mesh.triangles[t][size_t(i)]];
      const bool first = t == shell.first_triangle && i == 0;
      for (int a = 0; a < 3; ++a) {
        shell.min[a] = first ? p[a] : Min(shell.min[a], p[a]);
        shell.max[a] = first ? p[a] : Max(shell.max[a], p[a]);
      }
      corners[i] = p - r;
    }
    if (shell.oriented) shell.volume += Dot(corners[0], Cross(corners[1], corners[2])) / 6;
  }
  return absl::OkStatus();
}

bool IsFlipped(const Shell& shell) {
  constexpr double kRounding = 1e-9;
  const Vec3d size = shell.max - shell.min;
  return shell.oriented && shell.volume < -kRounding * (size.x * size.y * size.z);
}

}  // namespace voxelpipe
