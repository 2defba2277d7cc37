#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <cstring>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "encode/encode.h"
#include "support/json/json.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::AddFloats;
using testing::EmptyResult;
using testing::ParseJson;
using testing::ReadFile;
using testing::TemporaryDirectory;

// All elements of a level, z, y, x; of a component if `component` is not negative. Chunks that are left out are zero.
std::vector<float> ReadLevel(const std::string& path, int component = -1) {
  const json array = ParseJson(ReadFile(path + "/.zarray"));
  const size_t skip = component < 0 ? 0 : 1;
  EXPECT_EQ(array["dtype"], "<f4");
  const auto shape = array["shape"].get<std::vector<size_t>>();
  const auto chunks = array["chunks"].get<std::vector<size_t>>();
  const size_t nz = shape[skip], ny = shape[skip + 1], nx = shape[skip + 2];
  const size_t cz = chunks[skip], cy = chunks[skip + 1], cx = chunks[skip + 2];
  std::vector<float> all(nz * ny * nx), chunk(cz * cy * cx);
  for (size_t k = 0; k * cz < nz; ++k) {
    for (size_t j = 0; j * cy < ny; ++j) {
      for (size_t i = 0; i * cx < nx; ++i) {
        const std::string name =
            absl::StrCat(path, "/", component < 0 ? "" : absl::StrCat(component, "/"), k, "/", j, "/", i);
        if (!std::filesystem::exists(name)) continue;
        const std::vector<uint8_t> file = ReadFile(name);
        uLongf size = uLongf(chunk.size() * sizeof(float));
        EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(chunk.data()), &size, file.data(), uLong(file.size())), Z_OK);
        EXPECT_EQ(size, chunk.size() * sizeof(float));
        for (size_t z = 0; z < cz; ++z) {
          for (size_t y = 0; y < cy; ++y) {
            for (size_t x = 0; x < cx; ++x) {
              const size_t at[3] = {k * cz + z, j * cy + y, i * cx + x};
              if (at[0] >= nz || at[1] >= ny || at[2] >= nx) continue;
              all[(at[0] * ny + at[1]) * nx + at[2]] = chunk[(z * cy + y) * cx + x];
            }
          }
        }
      }
    }
  }
  return all;
}

// Of each component the value of the largest magnitude, the first of equal ones.
std::vector<float> Halved(const std::vector<float>& values, const std::array<size_t, 3>& dims) {
  const auto [nz, ny, nx] = dims;
  const size_t hz = (nz + 1) / 2, hy = (ny + 1) / 2, hx = (nx + 1) / 2;
  std::vector<float> half(hz * hy * hx);
  for (size_t k = 0; k < nz; ++k) {
    for (size_t j = 0; j < ny; ++j) {
      for (size_t i = 0; i < nx; ++i) {
        float& to = half[(k / 2 * hy + j / 2) * hx + i / 2];
        const float value = values[(k * ny + j) * nx + i];
        if (std::abs(value) > std::abs(to)) to = value;
      }
    }
  }
  return half;
}

// Mostly zeros, else numbers of both signs.
float SparseValue(int64_t i, int64_t j, int64_t k, int c) {
  const int64_t n = i + 31 * j + 101 * k + 57 * c;
  return n % 7 == 0 ? float(n * 7919 % 1000 - 500) : 0;
}

TEST(Zarr, EachLevelHasTheLargestMagnitudesOfTheOneBefore) {
  const TemporaryDirectory directory;
  constexpr size_t kX = 600, kY = 17, kZ = 35;  // more than two rows of chunks; odd sizes
  for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
    VoxelizeResult result = EmptyResult({kX, kY, kZ}, layout);
    result.grid.origin = {10, 20, 30};
    result.grid.voxel_size = {0.5, 0.25, 2};
    AddFloats(result, 2, SparseValue);
    const std::string path = directory / (layout == Layout::kPlanar ? "planar.zarr" : "interleaved.zarr");
    ASSERT_TRUE(WriteResult(result, path).ok());

    const json image = ParseJson(ReadFile(path + "/.zattrs"))["multiscales"][0];
    ASSERT_EQ(image["datasets"].size(), 3u);  // 600, 300, 150
    for (const json& axis : image["axes"]) EXPECT_FALSE(axis.contains("unit")) << "that of the mesh is not known";
    EXPECT_EQ(image["datasets"][2]["path"], "2");
    EXPECT_EQ(image["datasets"][2]["coordinateTransformations"],
              ParseJson(R"([{"type": "scale", "scale": [1, 8.0, 1.0, 2.0]},
                              {"type": "translation", "translation": [0, 34.0, 20.5, 11.0]}])"));
    for (int c = 0; c < 2; ++c) {
      std::vector<float> expected;
      for (size_t n = 0; n < kX * kY * kZ; ++n) {
        expected.push_back(SparseValue(int64_t(n % kX), int64_t(n / kX % kY), int64_t(n / kX / kY), c));
      }
      EXPECT_EQ(ReadLevel(path + "/0", c), expected);
      expected = Halved(expected, {kZ, kY, kX});
      EXPECT_EQ(ReadLevel(path + "/1", c), expected);
      expected = Halved(expected, {18, 9, 300});
      EXPECT_EQ(ReadLevel(path + "/2", c), expected);
    }
  }
}

TEST(Zarr, ASmallImageHasOneLevel) {
  const TemporaryDirectory directory;
  VoxelizeResult result = EmptyResult({4, 5, 6});
  AddFloats(result, 1, [](int64_t, int64_t, int64_t, int) { return 1.5f; });
  const std::string path = directory / "small.zarr";
  ASSERT_TRUE(WriteResult(result, path).ok());
  EXPECT_EQ(ParseJson(ReadFile(path + "/.zattrs"))["multiscales"][0]["datasets"].size(), 1u);
  EXPECT_EQ(ReadLevel(path + "/0"), std::vector<float>(4 * 5 * 6, 1.5f));
}

}  // namespace
}  // namespace voxelpipe
