// The files of the page, which are part of the program.
#pragma once

#include <string_view>

namespace voxelpipe {

struct PageFile {
  std::string_view path;  // "/page.js"
  const char* type;       // of its contents
  std::string_view text;
};

// In: the path of a request. Out: the file; null if there is none.
const PageFile* FindPageFile(std::string_view path);

}  // namespace voxelpipe
