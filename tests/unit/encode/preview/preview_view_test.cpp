#include "encode/preview/preview_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include "encode/png_preview.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using testing::EmptyResult;

PreviewOptions Seen(const PreviewView& view) {
  PreviewOptions options{.width = 512, .height = 384, .samples = 1};
  options.view = view;
  return options;
}

// A base without a corner and two towers of different heights: every view has a silhouette of its own.
constexpr std::array<int64_t, 3> kDims{12, 8, 6};
bool InBody(int64_t i, int64_t j, int64_t k) {
  return (j < 2 && !(i >= 6 && k >= 4)) || (i < 4 && k >= 4) || (i >= 10 && k < 2 && j < 5);
}

VoxelizeResult Body() {
  VoxelizeResult result = EmptyResult(kDims);
  AddBits(result, InBody);
  return result;
}

TEST(ParseView, TakesNamesAndAngles) {
  EXPECT_EQ(ParseView("iso").value(), PreviewView());
  EXPECT_EQ(ParseView("front").value(), (PreviewView{0, 0}));
  EXPECT_EQ(ParseView("-30,12.5").value(), (PreviewView{-30, 12.5}));
  EXPECT_EQ(ParseView("360,-90").value(), (PreviewView{360, -90}));
}

TEST(ParseView, QuotesWhatIsWrongAndListsTheNames) {
  for (const std::string text : {"", "Front", "upside", "45", "45,", ",45", "1,2,3", "nan,0", "inf,0", "361,0", "0,91",
                                 "0,-90.5", "0;1", "0, 1", "0,1 "}) {
    const absl::Status status = ParseView(text).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
    EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("'" + text + "'"));
    EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("front, back, left, right, top, bottom"));
  }
}

TEST(FrameOf, IsExactAlongAxesAndOrthonormalElsewhere) {
  const auto frame = [](const char* name) { return FrameOf(ParseView(name).value()); };
  EXPECT_EQ(frame("front").eye, (Vec3d{0, 0, 1}));
  EXPECT_EQ(frame("back").eye, (Vec3d{0, 0, -1}));
  EXPECT_EQ(frame("right").eye, (Vec3d{1, 0, 0}));
  EXPECT_EQ(frame("left").eye, (Vec3d{-1, 0, 0}));
  EXPECT_EQ(frame("top").eye, (Vec3d{0, 1, 0}));
  EXPECT_EQ(frame("top").up, (Vec3d{0, 0, -1}));
  EXPECT_EQ(frame("bottom").up, (Vec3d{0, 0, 1}));
  for (double azimuth = -360; azimuth <= 360; azimuth += 7.5) {
    for (double elevation = -90; elevation <= 90; elevation += 7.5) {
      const ViewFrame f = FrameOf({azimuth, elevation});
      for (const Vec3d& v : {f.right, f.up, f.eye}) EXPECT_NEAR(Dot(v, v), 1, 1e-12);
      EXPECT_NEAR(Dot(f.right, f.up), 0, 1e-12);
      EXPECT_NEAR(Dot(f.right, f.eye), 0, 1e-12);
      EXPECT_GE(f.up.y, 0);
    }
  }
}

// Whether a pixel shows the blue clay of plain bits; ground and shadow are grey.
bool IsClay(const Picture& picture, int x, int y) {
  const uint8_t* const pixel = &picture.rgb[size_t(3 * (y * picture.width + x))];
  return int(pixel[2]) - int(pixel[0]) > 35;
}

TEST(RenderPreview, EachNamedViewShowsTheSilhouetteFromItsSide) {
  struct Side {
    const char* name;
    int across;  // the grid's axis to the right, ~axis if it points to the left
    int upwards;
  };
  for (const Side& side :
       {Side{"front", 0, 1}, {"back", ~0, 1}, {"right", ~2, 1}, {"left", 2, 1}, {"top", 0, ~2}, {"bottom", 0, 2}}) {
    const Picture picture = RenderPreview(Body(), Seen(ParseView(side.name).value())).value();
    const int view_width = picture.width * 3 / 4, corner = 80;  // the axes are in the lower left corner
    int left = view_width, right = 0, top = picture.height, bottom = 0;
    for (int y = 0; y < picture.height; ++y) {
      for (int x = 0; x < view_width; ++x) {
        if ((x < corner && y >= picture.height - corner) || !IsClay(picture, x, y)) continue;
        left = std::min(left, x);
        right = std::max(right, x + 1);
        top = std::min(top, y);
        bottom = std::max(bottom, y + 1);
      }
    }
    const int a = side.across < 0 ? ~side.across : side.across, b = side.upwards < 0 ? ~side.upwards : side.upwards;
    const int depth = 3 - a - b;
    const int64_t columns = kDims[size_t(a)], rows = kDims[size_t(b)];
    ASSERT_LT(left, right) << side.name;
    EXPECT_NEAR(double(right - left) / double(bottom - top), double(columns) / double(rows), 0.05) << side.name;
    for (int64_t u = 0; u < columns; ++u) {
      for (int64_t v = 0; v < rows; ++v) {
        bool expected = false;
        std::array<int64_t, 3> voxel{};
        voxel[size_t(a)] = side.across < 0 ? columns - 1 - u : u;
        voxel[size_t(b)] = side.upwards < 0 ? rows - 1 - v : v;
        for (voxel[size_t(depth)] = 0; voxel[size_t(depth)] < kDims[size_t(depth)]; ++voxel[size_t(depth)]) {
          expected = expected || InBody(voxel[0], voxel[1], voxel[2]);
        }
        const int x = left + int((double(u) + 0.5) * (right - left) / double(columns));
        const int y = bottom - 1 - int((double(v) + 0.5) * (bottom - top) / double(rows));
        EXPECT_EQ(IsClay(picture, x, y), expected) << side.name << " " << u << " " << v;
      }
    }
  }
}

TEST(RenderPreview, AnglesOfTheDefaultViewGiveItsPicture) {
  const Picture picture = RenderPreview(Body(), Seen({})).value();
  EXPECT_EQ(picture.rgb, RenderPreview(Body(), Seen(ParseView("45,35.264389682754654").value())).value().rgb);
  EXPECT_NE(picture.rgb, RenderPreview(Body(), Seen({225, 35.264389682754654})).value().rgb);
}

TEST(RenderPreview, RefusesAViewOutOfRange) {
  for (const PreviewView& view : {PreviewView{361, 0}, PreviewView{0, -91}, PreviewView{std::nan(""), 0}}) {
    EXPECT_EQ(RenderPreview(Body(), Seen(view)).status().code(), absl::StatusCode::kInvalidArgument);
  }
}

TEST(RenderPreview, IsTheSameWithOneThreadAndWithMany) {
  VoxelizeResult result = EmptyResult({70, 50, 60});
  AddBits(result, [](int64_t i, int64_t j, int64_t k) { return (i - 35) * (i - 35) + j * j + (k - 30) * k < 900; });
  AddFloats(
      result, 3, [](int64_t i, int64_t j, int64_t k, int c) { return float((i * 3 + j * 5 + k * 7 + c) % 11) / 11; },
      "base_color");
  PreviewOptions options = Seen({});
  options.samples = 2;
  Picture one, many;
  {
    const tbb::global_control single(tbb::global_control::max_allowed_parallelism, 1);
    one = RenderPreview(result, options).value();
  }
  const tbb::global_control more(tbb::global_control::max_allowed_parallelism, 7);
  tbb::task_arena arena(7);
  arena.execute([&] { many = RenderPreview(result, options).value(); });
  EXPECT_EQ(one.rgb, many.rgb);
  EXPECT_EQ(EncodePng(one).value(), EncodePng(many).value());
}

}  // namespace
}  // namespace voxelpipe
