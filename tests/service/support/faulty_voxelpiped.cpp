// voxelpiped with one more device: "cuda:0", which does the CPU's work and breaks as the file named by
// VOXELPIPE_TEST_FAULTS says. Built with the server's own main, before which the device is there.
#include <cstdlib>

#include "pipeline/stages/backend.h"
#include "support/faulty_backend.h"

namespace {

[[maybe_unused]] const bool registered = [] {
  const char* const file = std::getenv("VOXELPIPE_TEST_FAULTS");
  // Like all devices it lives as long as the process, threads that were left behind in it included.
  voxelpipe::RegisterDevice(new voxelpipe::testing::FaultyBackend("cuda:0", file == nullptr ? "" : file));
  return true;
}();

}  // namespace
