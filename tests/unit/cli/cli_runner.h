// Runs the real command line tool and makes meshes for it.
#pragma once

#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "support/json/json.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe::testing {

struct CliOutcome {
  int exit_code = -1;  // -signal if a signal ended it
  std::string out, err;
};

std::string ShellQuoted(const std::string& text);

// `prefix` goes before the command, e.g. "ulimit -v 100000;", `redirections` behind it, e.g. "<mesh.glb".
CliOutcome RunCli(const std::vector<std::string>& arguments, const std::string& prefix = "",
                  const std::string& redirections = "");

size_t LineCount(const std::string& text);

// A closed box from 0 to (x, y, z) metres, 12 triangles, as a GLB file.
void WriteBoxGlb(const std::string& path, float x, float y, float z);

}  // namespace voxelpipe::testing
