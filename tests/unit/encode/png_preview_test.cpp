#include "encode/png_preview.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>

#include "encode/preview_volume.h"
#include "sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using testing::BitFormula;
using testing::EmptyResult;
using testing::ReadFile;
using testing::TemporaryDirectory;

constexpr PreviewOptions kSmall{.width = 256, .height = 192, .samples = 1};

BitFormula Ball(double middle, double radius) {
  return [=](int64_t i, int64_t j, int64_t k) {
    return std::hypot(double(i) + 0.5 - middle, double(j) + 0.5 - middle, double(k) + 0.5 - middle) <= radius;
  };
}

VoxelizeResult BallResult(int64_t n, double share = 0.45) {
  VoxelizeResult result = EmptyResult({n, n, n});
  AddBits(result, Ball(double(n) / 2, share * double(n)));
  return result;
}

Picture Decode(const std::vector<uint8_t>& file) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  Picture picture;
  if (!png_image_begin_read_from_memory(&image, file.data(), file.size())) return picture;
  image.format = PNG_FORMAT_RGB;
  picture.width = int(image.width);
  picture.height = int(image.height);
  picture.rgb.resize(PNG_IMAGE_SIZE(image));
  if (!png_image_finish_read(&image, nullptr, picture.rgb.data(), 0, nullptr)) picture.rgb.clear();
  return picture;
}

// Mean of a channel over the middle of the isometric view.
double MiddleMean(const Picture& picture, int channel) {
  double sum = 0;
  const int x0 = picture.width * 3 / 8, y0 = picture.height / 2;
  for (int y = y0 - 8; y < y0 + 8; ++y) {
    for (int x = x0 - 8; x < x0 + 8; ++x) sum += picture.rgb[size_t(3 * (y * picture.width + x) + channel)];
  }
  return sum / 256;
}

TEST(WritePreview, IsAPngOfTheAskedSizeWithThePicturesPixels) {
  const TemporaryDirectory directory;
  const VoxelizeResult result = BallResult(24);
  ASSERT_TRUE(WritePreview(result, directory / "a.png", kSmall).ok());
  const Picture drawn = RenderPreview(result, kSmall).value();
  const Picture read = Decode(ReadFile(directory / "a.png"));
  EXPECT_EQ(read.width, 256);
  EXPECT_EQ(read.height, 192);
  EXPECT_EQ(read.rgb, drawn.rgb);
  EXPECT_EQ(directory.FileCount(), 1u);
}

TEST(RenderPreview, IsTheSameEachTimeAndDiffersBetweenShapes) {
  const Picture ball = RenderPreview(BallResult(24), kSmall).value();
  EXPECT_EQ(ball.rgb, RenderPreview(BallResult(24), kSmall).value().rgb);
  VoxelizeResult box = EmptyResult({24, 24, 24});
  AddBits(box, [](int64_t i, int64_t j, int64_t k) { return i > 3 && j > 3 && k > 3; });
  EXPECT_NE(ball.rgb, RenderPreview(box, kSmall).value().rgb);
}

TEST(RenderPreview, ShowsTheMeshAgainstTheGround) {
  const Picture picture = RenderPreview(BallResult(32), kSmall).value();
  // The default colour is blue; the ground is a light grey.
  EXPECT_GT(MiddleMean(picture, 2), MiddleMean(picture, 0) + 30);
  EXPECT_LT(std::abs(int(picture.rgb[0]) - int(picture.rgb[2])), 20);
}

TEST(RenderPreview, TakesColoursFromAThreeComponentTarget) {
  for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
    VoxelizeResult result = EmptyResult({32, 32, 32}, layout);
    AddBits(result, Ball(16, 14));
    AddFloats(
        result, 3, [](int64_t, int64_t, int64_t, int c) { return c == 0 ? 0.8f : 0.02f; }, "base_color");
    const Picture picture = RenderPreview(result, kSmall).value();
    EXPECT_GT(MiddleMean(picture, 0), MiddleMean(picture, 1) + 60);
    EXPECT_GT(MiddleMean(picture, 0), MiddleMean(picture, 2) + 60);
  }
}

TEST(RenderPreview, ShowsVoxelsThatAreNotClearWhereThereAreNoBits) {
  VoxelizeResult result = EmptyResult({32, 32, 32});
  const BitFormula ball = Ball(16, 14);
  AddFloats(result, 3,
            [&](int64_t i, int64_t j, int64_t k, int c) { return ball(i, j, k) ? (c == 1 ? 0.7f : 0.1f) : -5.0f; });
  result.specs[0].clear = -5;
  const Picture picture = RenderPreview(result, kSmall).value();
  EXPECT_GT(MiddleMean(picture, 1), MiddleMean(picture, 0) + 40);
}

TEST(RenderPreview, DrawsScalarsThroughAColourMap) {
  VoxelizeResult result = EmptyResult({32, 32, 32});
  AddBits(result, Ball(16, 14));
  AddFloats(
      result, 1, [](int64_t, int64_t j, int64_t, int) { return float(j); }, "triangle_id");
  EXPECT_NE(RenderPreview(result, kSmall).value().rgb, RenderPreview(BallResult(32, 14.0 / 32), kSmall).value().rgb);
}

TEST(RenderPreview, HandlesEmptyThinAndOddGrids) {
  VoxelizeResult empty = EmptyResult({4, 4, 4});
  AddBits(empty, [](int64_t, int64_t, int64_t) { return false; });
  EXPECT_TRUE(RenderPreview(empty, kSmall).ok());
  for (const std::array<int64_t, 3> dims :
       {std::array<int64_t, 3>{1, 1, 1}, {1000, 1, 1}, {1, 700, 3}, {3, 1, 300}, {65, 33, 17}}) {
    VoxelizeResult result = EmptyResult(dims);
    result.grid.voxel_size = {1e-3, 5, 1e9};
    AddBits(result, [](int64_t, int64_t, int64_t) { return true; });
    EXPECT_TRUE(RenderPreview(result, kSmall).ok()) << dims[0] << "x" << dims[1] << "x" << dims[2];
  }
}

TEST(RenderPreview, RefusesSizesOutOfRangeAndResultsWithoutTargets) {
  const VoxelizeResult result = BallResult(8);
  EXPECT_EQ(RenderPreview(result, {.width = 10, .height = 100}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(RenderPreview(result, {.width = 100, .height = 100000}).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(RenderPreview(result, {.samples = 0}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(RenderPreview(EmptyResult({1, 1, 1})).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(PreviewVolume, TraceFindsWhatAWalkThroughAllVoxelsFinds) {
  VoxelizeResult result = EmptyResult({37, 29, 41});
  AddBits(result, [](int64_t i, int64_t j, int64_t k) { return (i * 73 + j * 179 + k * 283) % 47 == 0; });
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  int hits = 0, compared = 0;
  for (int ray = 0; ray < 400; ++ray) {
    const Vec3d from{-20.0 + ray % 7, -13.0 + ray % 11, -9.0 + ray % 5};
    const Vec3d to{37.0 * ((ray * 31) % 97) / 97, 29.0 * ((ray * 17) % 89) / 89, 41.0 * ((ray * 13) % 83) / 83};
    const Vec3d direction = (to - from) * (1 / std::sqrt(Dot(to - from, to - from)));
    const PreviewHit hit = volume.Trace(from, direction, 0, 200);
    // The walk takes steps far smaller than a voxel; it can only be later than the ray, by less than what one step may
    // pass over.
    double walked = -1;
    for (double t = 0; t < 200 && walked < 0; t += 2e-3) {
      const Vec3d p = from + direction * t;
      if (volume.Solid(int64_t(std::floor(p.x)), int64_t(std::floor(p.y)), int64_t(std::floor(p.z)))) walked = t;
    }
    if (walked < 0) continue;
    ++compared;
    ASSERT_TRUE(hit.hit) << ray;
    ASSERT_LE(hit.t, walked + 1e-6) << ray;
    if (hit.t > walked - 3e-3) ++hits;  // otherwise it met the corner of a voxel that the walk stepped over
    ASSERT_TRUE(volume.Solid(hit.voxel[0], hit.voxel[1], hit.voxel[2]));
  }
  EXPECT_GT(compared, 200);
  EXPECT_GT(hits, compared * 9 / 10);
}

TEST(PreviewVolume, BoxAndRowsAreThoseOfTheBits) {
  VoxelizeResult result = EmptyResult({71, 5, 6});
  const auto formula = [](int64_t i, int64_t j, int64_t k) {
    return i >= 9 && i < 67 && j == 3 && k >= 1 && k < 5 && i % 2 == 1;
  };
  AddBits(result, formula);
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  EXPECT_EQ(volume.lo(), (std::array<int64_t, 3>{9, 3, 1}));
  EXPECT_EQ(volume.hi(), (std::array<int64_t, 3>{66, 4, 5}));
  for (int64_t i = -40; i < 110; ++i) {
    for (int count = 1; count <= 32; ++count) {
      uint32_t expected = 0;
      for (int bit = 0; bit < count; ++bit) {
        if (i + bit >= 0 && i + bit < 71 && formula(i + bit, 3, 2)) expected |= 1u << bit;
      }
      ASSERT_EQ(volume.Row(i, 3, 2, count), expected) << i << " " << count;
    }
  }
  EXPECT_EQ(volume.Row(0, -1, 2, 32), 0u);
  EXPECT_EQ(volume.Row(0, 3, 6, 32), 0u);
}

}  // namespace
}  // namespace voxelpipe
