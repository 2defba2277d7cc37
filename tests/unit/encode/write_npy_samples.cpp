// write_npy_samples DIR: one .npy for each shape and layout, for check_npy.py.
#include <cstdio>

#include "absl/strings/str_cat.h"
#include "encode/encode.h"
#include "sample_results.h"

int main(int argc, char** argv) {
  using namespace voxelpipe;
  if (argc != 2) return 2;
  for (const std::array<int64_t, 3> dims :
       {std::array<int64_t, 3>{1, 1, 1}, {5, 3, 2}, {8, 8, 8}, {9, 1, 7}, {130, 65, 33}}) {
    for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
      VoxelizeResult result = testing::EmptyResult(dims, layout);
      testing::AddBits(result, testing::SampleBit);
      for (int c = 1; c <= 4; ++c) testing::AddFloats(result, c, testing::SampleValue);
      const std::string name = absl::StrCat(argv[1], "/", layout == Layout::kPlanar ? "planar" : "interleaved", "_",
                                            dims[0], "_", dims[1], "_", dims[2], ".npy");
      if (absl::Status status = WriteResult(result, name); !status.ok()) {
        std::fprintf(stderr, "%s\n", status.ToString().c_str());
        return 1;
      }
    }
  }
  return 0;
}
