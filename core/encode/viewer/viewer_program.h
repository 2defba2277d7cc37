// The parts of a .html result that are the same for all: made of the files of this folder when VoxelPipe is built
// (cmake/VoxelpipeViewer.cmake).
#pragma once

#include <string_view>

namespace voxelpipe {

// The page up to the data.
std::string_view ViewerPage();
// The bundled script, an ES module.
std::string_view ViewerScript();

}  // namespace voxelpipe
