#include "pipeline/plan/plan.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "job/result.h"
#include "shaders/blend_ops.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

absl::Status At(const std::string& field, const absl::Status& why) {
  return absl::Status(why.code(), absl::StrCat(field, ": ", why.message()));
}

absl::Status Invalid(const std::string& field, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat(field, ": ", why));
}

bool IsPowerOfTwo(double v) {
  int exponent;
  return std::isfinite(v) && v > 0 && std::frexp(v, &exponent) == 0.5;
}

bool TakesSrgb(std::string_view shader) {
  return shader == "base_color" || shader == "emissive" || shader == "color" || shader == "constant";
}

absl::Status ValidateEncoding(const TargetSpec& target, const std::string& field) {
  if (target.encoding == Encoding::kLinear) return absl::OkStatus();
  const std::string name(Name(target.encoding));
  const bool srgb = target.encoding == Encoding::kSrgb;
  if (target.format != VoxelFormat::kU8 && (srgb || target.format != VoxelFormat::kU16)) {
    return Invalid(field, name + (srgb ? " is for u8" : " is for u8 and u16"));
  }
  if (!(srgb ? TakesSrgb(target.shader.name) : TakesSnorm(target.shader.name))) {
    return Invalid(field,
                   name + " is for the shaders " +
                       (srgb ? "base_color, emissive, color and constant" : "normal, geometric_normal and tangent"));
  }
  if (target.scale) return Invalid(field, name + " and scale exclude one another");
  for (const Blend blend : {Blend::kCount, Blend::kAnd, Blend::kOr}) {
    if (target.blend == blend)
      return Invalid(field, absl::StrCat(name, " does not go with ", std::string(Name(blend))));
  }
  return absl::OkStatus();
}

absl::Status ValidateTarget(const TargetSpec& target, const std::string& field) {
  if (IsEncoded(target.format)) return Invalid(field + ".format", "is no format of a request; set `encoding`");
  if (target.components < 1 || target.components > 4) return Invalid(field + ".components", "must be 1 to 4");
  if (target.format == VoxelFormat::kBit && target.components != 1) {
    return Invalid(field + ".components", "a bit target has 1 component");
  }
  if (absl::Status s = CheckBlend(target.format, target.blend); !s.ok()) return At(field + ".blend", s);
  if (auto shader = BindShader(ShaderStage::kFragment, target.shader); !shader.ok()) {
    return At(field + ".shader", shader.status());
  }
  if (target.scale) {
    const bool integer =
        target.format == VoxelFormat::kU8 || target.format == VoxelFormat::kU16 || target.format == VoxelFormat::kU32;
    if (!integer) return Invalid(field + ".scale", "is for integer formats");
    if (!std::isfinite(*target.scale)) return Invalid(field + ".scale", "must be finite");
  }
  if (!IsPowerOfTwo(target.quantum) || target.quantum < 0x1p-126 || target.quantum > 0x1p80) {
    return Invalid(field + ".quantum", "must be a power of two from 2^-126 to 2^80");
  }
  if (!std::isfinite(target.clear)) return Invalid(field + ".clear", "must be finite");
  if (target.fill_values.size() > 1 && target.fill_values.size() != size_t(target.components)) {
    return Invalid(field + ".fill", absl::StrCat("one number, or one for each of ", target.components, " components; ",
                                                 target.fill_values.size(), " given"));
  }
  for (const double value : target.fill_values) {
    if (!std::isfinite(value)) return Invalid(field + ".fill", "must be finite");
  }
  return ValidateEncoding(target, field + ".encoding");
}

absl::Status ValidateCoverage(const VoxelizeRequest& request) {
  const bool buckets = request.result == ResultKind::kBuckets;
  if (request.parts.scope != PartScope::kWhole && request.fill == Fill::kFlood) {
    return Invalid("fill", "flood fills the whole mesh; parts take parity or nonzero");
  }
  if (buckets && request.fill != Fill::kNone) {
    return Invalid("fill", "buckets list fragments; there is nothing to fill");
  }
  if (buckets && request.coverage == Coverage::kCenter) return Invalid("coverage", "buckets take conservative or thin");
  if (request.coverage != Coverage::kNone) return absl::OkStatus();
  if (buckets) return Invalid("coverage", "none: buckets list fragments, and no voxel has any");
  if (CastsLines(request.fill)) return absl::OkStatus();
  return Invalid("coverage", absl::StrCat("none takes fill parity or nonzero, not ", std::string(Name(request.fill))));
}

}  // namespace

std::string_view Name(PartScope scope) {
  switch (scope) {
    case PartScope::kWhole: return "whole";
    case PartScope::kFile: return "file";
    case PartScope::kNode: return "node";
    case PartScope::kMesh: return "mesh";
    case PartScope::kMaterial: return "material";
  }
  return "whole";
}
std::string_view Name(Coverage coverage) {
  switch (coverage) {
    case Coverage::kConservative: return "conservative";
    case Coverage::kThin: return "thin";
    case Coverage::kCenter: return "center";
    case Coverage::kNone: return "none";
  }
  return "unknown";
}

std::string_view Name(Fill fill) {
  switch (fill) {
    case Fill::kNone: return "none";
    case Fill::kParity: return "parity";
    case Fill::kFlood: return "flood";
    case Fill::kNonzero: return "nonzero";
  }
  return "unknown";
}

std::string_view Name(SimdChoice simd) {
  switch (simd) {
    case SimdChoice::kAuto: return "auto";
    case SimdChoice::kScalar: return "scalar";
    case SimdChoice::kAvx2: return "avx2";
    case SimdChoice::kAvx512: return "avx512";
  }
  return "unknown";
}

std::string_view Name(BackendChoice backend) {
  switch (backend) {
    case BackendChoice::kAuto: return "auto";
    case BackendChoice::kCpu: return "cpu";
    case BackendChoice::kCuda: return "cuda";
  }
  return "unknown";
}

uint64_t TargetBytes(const TargetSpec& target, uint64_t voxels) {
  return ArrayBytes(ElementOf(target.format), voxels * uint64_t(target.components));
}

absl::Status ValidateRequest(const VoxelizeRequest& request) {
  if (request.targets.empty()) return Invalid("targets", "at least one is needed");
  // Before the rest, as clients of a server see it: a grid in none of its forms has no message.
  if (absl::Status s = CheckGridRequest(request.grid); !s.ok()) return s;
  if (auto shader = BindShader(ShaderStage::kVertex, request.vertex_shader); !shader.ok()) {
    return At("vertex_shader", shader.status());
  }
  if (request.targets.size() > size_t{kMaxTargets}) {
    return Invalid("targets",
                   absl::StrCat("at most ", kMaxTargets, " are possible, ", request.targets.size(), " given"));
  }
  for (size_t i = 0; i < request.targets.size(); ++i) {
    if (absl::Status s = ValidateTarget(request.targets[i], absl::StrCat("targets[", i, "]")); !s.ok()) return s;
  }
  if (absl::Status s = ValidateCoverage(request); !s.ok()) return s;
  if (request.threads < 0) return Invalid("threads", "must not be negative");
  return absl::OkStatus();
}

PlanLimits LimitsInProcess(const JobContext& job) {
  PlanLimits limits;
  const MemoryBudget& memory = MemoryOf(job);
  const uint64_t left = memory.limit_bytes() - std::min(memory.limit_bytes(), memory.used_bytes());
  if (left >= limits.max_working_bytes) return limits;
  limits.max_working_bytes = left;
  limits.working_limit_is = job.memory() == nullptr ? "half of this machine's memory, less the mesh"
                                                    : "what the job's budget has left beside the mesh";
  return limits;
}

}  // namespace voxelpipe
