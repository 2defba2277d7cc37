#include "encode/viewer/viewer_program.h"

// Of cmake/VoxelpipeEmbed.cmake.
extern "C" {
extern const char voxelpipe_viewer_page_begin[], voxelpipe_viewer_page_end[];
extern const char voxelpipe_viewer_script_begin[], voxelpipe_viewer_script_end[];
}

namespace voxelpipe {

std::string_view ViewerPage() {
  return {voxelpipe_viewer_page_begin, size_t(voxelpipe_viewer_page_end - voxelpipe_viewer_page_begin)};
}

std::string_view ViewerScript() {
  return {voxelpipe_viewer_script_begin, size_t(voxelpipe_viewer_script_end - voxelpipe_viewer_script_begin)};
}

}  // namespace voxelpipe
