#include "encode/viewer/viewer_program.h"

// VIEWER_PAGE and VIEWER_SCRIPT name the files.
__asm__(
    ".section .rodata\n"
    "voxelpipe_viewer_page: .incbin \"" VIEWER_PAGE
    "\"\n"
    "voxelpipe_viewer_page_end:\n"
    "voxelpipe_viewer_script: .incbin \"" VIEWER_SCRIPT
    "\"\n"
    "voxelpipe_viewer_script_end:\n"
    ".byte 0\n"
    ".previous\n");

extern "C" {
extern const char voxelpipe_viewer_page[] __attribute__((visibility("hidden")));
extern const char voxelpipe_viewer_page_end[] __attribute__((visibility("hidden")));
extern const char voxelpipe_viewer_script[] __attribute__((visibility("hidden")));
extern const char voxelpipe_viewer_script_end[] __attribute__((visibility("hidden")));
}

namespace voxelpipe {

std::string_view ViewerPage() {
  return {voxelpipe_viewer_page, size_t(voxelpipe_viewer_page_end - voxelpipe_viewer_page)};
}

std::string_view ViewerScript() {
  return {voxelpipe_viewer_script, size_t(voxelpipe_viewer_script_end - voxelpipe_viewer_script)};
}

}  // namespace voxelpipe
