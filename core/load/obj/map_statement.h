// The arguments of a texture statement of a material library: "map_Kd -s 2 2 1 wood.png".
#pragma once

#include <string_view>

#include "base/job_context.h"

namespace voxelpipe::obj {

struct MapStatement {
  std::string_view name;  // of the file, or a data: URI; may hold spaces
  float offset[3] = {0, 0, 0}, scale[3] = {1, 1, 1};
  bool clamp = false;
};

// In: what follows the keyword. Options that change no result here are skipped. The job is polled; the statement is of
// no use once it is over.
MapStatement ParseMapStatement(const JobContext& job, std::string_view arguments);

}  // namespace voxelpipe::obj
