// The process that decodes untrusted meshes: the server's own binary, started again with a hidden argument.
#pragma once

#include <cstdint>
#include <span>

#include "isolate/archive.h"
#include "load/load_mesh.h"

namespace voxelpipe {

// The argument, and the open descriptors of the process: a socket, the region that it reads and the one that it writes.
inline constexpr const char* kLoadWorkerArgument = "--load-worker";
inline constexpr int kWorkerSocket = 3, kWorkerIn = 4, kWorkerOut = 5;
// The signal carries the number of the request to cancel (its low 31 bits).
inline constexpr int kCancelSignal = 10;  // SIGUSR1

// The fields of a request besides the file or the textures. Both processes are of one build.
struct LoadQuestion {
  MeshFormat format = MeshFormat::kAuto;
  LengthUnit unit = LengthUnit::kNone;
  TextureUse textures;
  LoadLimits limits;
  int64_t deadline_ns = 0;    // of the steady clock; 0: none
  uint64_t memory_bytes = 0;  // limit for loading; 0: none
  uint32_t threads = 1;
};

template <typename A, typename Q>
void QuestionFields(A& archive, Q& question) {
  archive.Enum(question.format, MeshFormat::k3mf);
  archive.Enum(question.unit, LengthUnit::kInch);
  archive.Flag(question.textures.base_color);
  archive.Flag(question.textures.emissive);
  archive.Flag(question.textures.metallic_roughness);
  archive.Value(question.limits);
  archive.Value(question.deadline_ns);
  archive.Value(question.memory_bytes);
  archive.Value(question.threads);
}

// Serves requests until the server ends. `threads`: maximum of this process. `kept_bytes`: maximum free memory kept at
// the end of its heap, because fresh pages cost more than copying. Out: the exit code.
int RunLoadWorker(int threads, int kept_bytes);

}  // namespace voxelpipe
