#include "gpu/cases/parity_subjects.h"

#include "gpu/cases/fine_mesh_cases.h"
#include "gpu/cases/scattered_cases.h"
#include "gpu/cases/solid_cases.h"

namespace voxelpipe::gpu {

std::optional<Subject> MakeSubject(const ParityMesh& named, uint32_t number, const ParityOptions& options) {
  Subject subject;
  subject.named = named;
  subject.rigged = named.name == "rigged";
  const bool first = number <= 3;  // those with attributes
  // For these alone, where `quick`.
  const bool bricks = named.name == "sphere", rows = named.name == "sphere5k", bundles = named.name == "of_all_sizes";
  const bool small = number == 1 || named.name == "pile_in_a_voxel" || named.name == "scattered" ||
                     named.name == "giants" || named.name == "crowd" || named.name == "throng" ||
                     named.name == "point" || bricks || rows || bundles;
  if (options.quick && !small) return std::nullopt;
  subject.mesh = std::make_shared<const TriangleMesh>(named.make());
  subject.large = subject.mesh->triangles.size() > 10'000;
  const size_t triangles = subject.mesh->triangles.size();
  if (!options.quick || !(rows || bundles)) subject.cases = BrickCases(named, triangles);
  if (!options.quick || rows) AppendTo(subject.cases, RowCases(named, triangles));
  if (!options.quick || rows || bundles) AppendTo(subject.cases, BundleCases(named, triangles));
  AppendTo(subject.cases, FourCases(named));
  if (options.quick && (bricks || rows || bundles)) return subject;
  const CaseSizes sizes{first ? 300 : subject.rigged ? 96 : subject.large ? 16 : 32, !named.refusable, first};
  const auto others =
      options.quick ? QuickCases(named) : CasesFor(named, *subject.mesh, sizes, options.seed + 100 * number);
  subject.cases.insert(subject.cases.begin(), others.begin(), others.end());
  if (named.name == "scattered") AppendTo(subject.cases, ScatteredCases());
  if (named.extent > 0) AppendTo(subject.cases, PooledCases(named));
  if (named.extent > 0 && !options.quick) AppendTo(subject.cases, LargestIdCases(named));
  if (!named.refusable) AppendTo(subject.cases, SolidCases(*subject.mesh, options.quick || !first));
  return subject;
}

}  // namespace voxelpipe::gpu
