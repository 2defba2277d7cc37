// Warnings in the form that tests compare.
#pragma once

#include <string>
#include <vector>

#include "base/warning.h"

namespace voxelpipe::testing {

// "place: text" of each.
inline std::vector<std::string> Lines(const WarningList& warnings) {
  std::vector<std::string> lines;
  for (const Warning& warning : warnings.kept()) lines.push_back(warning.Line());
  return lines;
}

// "code" of each.
inline std::vector<std::string> Codes(const WarningList& warnings) {
  std::vector<std::string> codes;
  for (const Warning& warning : warnings.kept()) codes.emplace_back(Name(warning.code));
  return codes;
}

}  // namespace voxelpipe::testing
