#include "encode/png_preview.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <functional>
#include <tuple>

#include "encode/preview/preview_cells.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_values.h"
#include "encode/preview/preview_volume.h"
#include "sample_results.h"
#include "shaders/fragment/packed_normal.h"

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

TEST(RenderPreview, DrawsVelocitiesByTheirLengthWhateverTheirDirection) {
  const auto drawn = [](float sign, const std::string& shader) {
    VoxelizeResult result = EmptyResult({32, 32, 32});
    AddBits(result, Ball(16, 14));
    AddFloats(
        result, 3, [&](int64_t, int64_t j, int64_t, int c) { return c == 0 ? sign * float(j) : 0; }, shader);
    return RenderPreview(result, kSmall).value().rgb;
  };
  EXPECT_EQ(drawn(1, "velocity"), drawn(-1, "velocity"));
  EXPECT_NE(drawn(1, "velocity"), drawn(1, "base_color"));
  EXPECT_NE(drawn(1, "velocity"), drawn(0, "velocity"));
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

TEST(PreviewCells, TraceFindsWhatAWalkThroughAllVoxelsFinds) {
  VoxelizeResult result = EmptyResult({37, 29, 41});
  AddBits(result, [](int64_t i, int64_t j, int64_t k) { return (i * 73 + j * 179 + k * 283) % 47 == 0; });
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  const PreviewCells cells = PreviewCells::Build(volume, nullptr).value();
  int hits = 0, compared = 0;
  for (int ray = 0; ray < 400; ++ray) {
    const Vec3d from{-20.0 + ray % 7, -13.0 + ray % 11, -9.0 + ray % 5};
    const Vec3d to{37.0 * ((ray * 31) % 97) / 97, 29.0 * ((ray * 17) % 89) / 89, 41.0 * ((ray * 13) % 83) / 83};
    const Vec3d direction = (to - from) * (1 / std::sqrt(Dot(to - from, to - from)));
    const PreviewHit hit = cells.Trace(from, direction, 0, 200);
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
  const PreviewCells cells = PreviewCells::Build(volume, nullptr).value();
  EXPECT_EQ(cells.lo(), (std::array<int64_t, 3>{9, 3, 1}));
  EXPECT_EQ(cells.hi(), (std::array<int64_t, 3>{66, 4, 5}));
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

// The elements of a target, as many as `items` voxels or fragments have, in the result's layout.
void AddTarget(VoxelizeResult& result, TargetSpec spec, uint64_t items,
               const std::function<double(uint64_t item, int c)>& formula) {
  const auto components = uint64_t(spec.components), element = uint64_t(BitsPerComponent(spec.format) / 8);
  HostBuffer buffer = HostBuffer::Allocate(items * components * element).value();
  for (uint64_t item = 0; item < items; ++item) {
    for (int c = 0; c < spec.components; ++c) {
      const uint64_t at =
          result.layout == Layout::kPlanar ? uint64_t(c) * items + item : item * components + uint64_t(c);
      const uint32_t stored = StoredBits(NumberToCell(formula(item, c), spec.format), spec.format);
      std::memcpy(buffer.data() + at * element, &stored, element);  // little endian
    }
  }
  result.specs.push_back(std::move(spec));
  result.targets.push_back(std::move(buffer));
}

HostBuffer BufferOf(const std::vector<uint64_t>& words) {
  HostBuffer buffer = HostBuffer::Allocate(words.size() * 8).value();
  if (!words.empty()) std::memcpy(buffer.data(), words.data(), words.size() * 8);
  return buffer;
}

// The voxels of `formula` as a sparse result or as buckets of one to three fragments; targets are to be added.
VoxelizeResult Listed(ResultKind kind, std::array<int64_t, 3> d, Layout layout, const BitFormula& formula) {
  VoxelizeResult result = EmptyResult(d, layout);
  result.kind = kind;
  std::vector<uint64_t> voxels, offsets{0}, bricks, masks;
  if (kind == ResultKind::kBuckets) {
    for (int64_t n = 0; n < d[0] * d[1] * d[2]; ++n) {
      if (!formula(n % d[0], n / d[0] % d[1], n / d[0] / d[1])) continue;
      voxels.push_back(uint64_t(n));
      offsets.push_back(offsets.back() + 1 + uint64_t(n) % 3);
    }
    result.voxels = BufferOf(voxels);
    result.offsets = BufferOf(offsets);
    result.triangles = HostBuffer::Allocate(offsets.back() * 4).value();
    return result;
  }
  const int64_t bx = (d[0] + 7) / 8, by = (d[1] + 7) / 8, bz = (d[2] + 7) / 8;
  for (int64_t id = 0; id < bx * by * bz; ++id) {
    std::array<uint64_t, 8> mask{};
    for (int64_t bit = 0; bit < 512; ++bit) {
      const int64_t i = id % bx * 8 + bit % 8, j = id / bx % by * 8 + bit / 8 % 8, k = id / bx / by * 8 + bit / 64;
      if (i < d[0] && j < d[1] && k < d[2] && formula(i, j, k)) mask[size_t(bit / 64)] |= uint64_t{1} << (bit % 64);
    }
    if (mask == std::array<uint64_t, 8>{}) continue;
    bricks.push_back(uint64_t(id));
    masks.insert(masks.end(), mask.begin(), mask.end());
  }
  result.bricks = BufferOf(bricks);
  result.masks = BufferOf(masks);
  return result;
}

TargetSpec Spec(VoxelFormat format, int components, const std::string& shader, Blend blend = Blend::kReplace) {
  TargetSpec spec;
  spec.format = format;
  spec.components = components;
  spec.blend = blend;
  spec.shader = {shader, {}};
  return spec;
}

TEST(PreviewItems, FindExactlyTheListedVoxelsInTheirOrder) {
  const std::array<int64_t, 3> d{21, 10, 17};  // no multiple of a brick
  const auto formula = [](int64_t i, int64_t j, int64_t k) { return (i * 7 + j * 5 + k * 3) % 11 < 4 && i / 8 != 1; };
  const VoxelizeResult sparse = Listed(ResultKind::kSparse, d, Layout::kInterleaved, formula);
  const VoxelizeResult buckets = Listed(ResultKind::kBuckets, d, Layout::kInterleaved, formula);
  const PreviewItems in_sparse(sparse), in_buckets(buckets);
  std::vector<int> met(in_sparse.count(), 0);
  const auto* offsets = reinterpret_cast<const uint64_t*>(buckets.offsets.data());
  for (int64_t n = 0, listed = 0; n < d[0] * d[1] * d[2]; ++n) {
    if (!formula(n % d[0], n / d[0] % d[1], n / d[0] / d[1])) {
      ASSERT_EQ(in_sparse.Find(uint64_t(n)), PreviewItems::kNone) << n;
      ASSERT_EQ(in_buckets.Find(uint64_t(n)), PreviewItems::kNone) << n;
      ASSERT_EQ(in_buckets.FragmentsOf(uint64_t(n)), 0u) << n;
      continue;
    }
    ASSERT_LT(in_sparse.Find(uint64_t(n)), met.size());
    ++met[in_sparse.Find(uint64_t(n))];
    ASSERT_EQ(in_buckets.Find(uint64_t(n)), offsets[++listed] - 1) << n;  // the last fragment
    ASSERT_EQ(in_buckets.FragmentsOf(uint64_t(n)), 1 + uint64_t(n) % 3) << n;
  }
  EXPECT_EQ(in_buckets.MaxFragments(), 3u);
  EXPECT_THAT(met, ::testing::Each(1));
  EXPECT_EQ(in_sparse.Find(0), 0u);
}

TEST(RenderPreview, DrawsSrgbCodesAsTheColoursThatTheyStandFor) {
  const std::array<int64_t, 3> d{29, 30, 31};
  const auto linear = [](uint64_t, int c) { return c == 0 ? 0.5 : 0.03; };
  VoxelizeResult floats = EmptyResult(d), codes = EmptyResult(d);
  for (VoxelizeResult* result : {&floats, &codes}) AddBits(*result, Ball(15, 12));
  AddTarget(floats, Spec(VoxelFormat::kF32, 3, "base_color"), floats.grid.voxels(), linear);
  TargetSpec encoded = Spec(VoxelFormat::kU8, 3, "base_color");
  encoded.encoding = Encoding::kSrgb;
  AddTarget(codes, encoded, codes.grid.voxels(),
            [&](uint64_t item, int c) { return double(LinearToSrgb(linear(item, c))); });
  const Picture expected = RenderPreview(floats, kSmall).value(), drawn = RenderPreview(codes, kSmall).value();
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(MiddleMean(drawn, c), MiddleMean(expected, c), 2) << c;
}

TEST(RenderPreview, DrawsSparseAndBucketsAsTheDenseResultOfTheSameVoxels) {
  const std::array<int64_t, 3> d{29, 30, 31};
  const BitFormula ball = Ball(15, 12);
  VoxelizeResult dense = EmptyResult(d);
  AddBits(dense, ball);
  AddFloats(
      dense, 3, [](int64_t, int64_t, int64_t, int c) { return c == 0 ? 0.75f : 0.125f; }, "base_color");
  const Picture expected = RenderPreview(dense, kSmall).value();
  EXPECT_GT(MiddleMean(expected, 0), MiddleMean(expected, 1) + 60);
  for (const ResultKind kind : {ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
      for (const VoxelFormat format : {VoxelFormat::kF32, VoxelFormat::kF16}) {
        VoxelizeResult result = Listed(kind, d, layout, ball);
        AddTarget(result, Spec(format, 3, "base_color"), PreviewItems(result).count(),
                  [](uint64_t, int c) { return c == 0 ? 0.75 : 0.125; });
        EXPECT_EQ(RenderPreview(result, kSmall).value().rgb, expected.rgb) << Name(kind) << " " << Name(format);
      }
    }
  }
}

TEST(RenderPreview, ColoursBucketsWithoutValuesByTheirFragments) {
  const std::array<int64_t, 3> d{29, 30, 31};
  VoxelizeResult result = Listed(ResultKind::kBuckets, d, Layout::kInterleaved, Ball(15, 12));
  TargetSpec bits;
  result.specs.push_back(bits);
  result.targets.push_back(HostBuffer::Allocate((PreviewItems(result).count() + 7) / 8).value());
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  const PreviewColours colours(result, volume);
  const auto of = [&](uint64_t fragments) {  // a listed voxel with so many
    for (uint64_t n = 0;; ++n) {
      if (PreviewItems(result).FragmentsOf(n) == fragments) return colours.At(n);
    }
  };
  // The map runs from violet to yellow.
  EXPECT_LT(of(1).y, of(2).y);
  EXPECT_LT(of(2).y, of(3).y);
  EXPECT_GT(of(3).x, 0.9f);
}

TEST(PreviewColours, ASolidThatTheGridCutsShowsItsInside) {
  VoxelizeResult result = EmptyResult({8, 8, 8});
  AddBits(result, [](int64_t i, int64_t, int64_t) { return i < 5; });  // cut by five borders of the grid
  AddFloats(
      result, 3, [](int64_t i, int64_t, int64_t, int) { return i == 4 ? 1.0f : 0.0f; }, "base_color");
  const PreviewVolume volume = PreviewVolume::Build(result, nullptr).value();
  const PreviewColours colours(result, volume);
  EXPECT_EQ(colours.At(volume.Linear(2, 3, 0)).x, InsideColour().x);
  EXPECT_EQ(colours.At(volume.Linear(0, 0, 7)).x, InsideColour().x);
  EXPECT_EQ(colours.At(volume.Linear(4, 0, 0)).x, 1.0f);
}

TEST(RenderPreview, TakesColoursFromIntegersOverTheirScale) {
  const auto red = [](double scale) { return [=](uint64_t, int c) { return (c == 0 ? 0.8 : 0.0) * scale; }; };
  std::vector<Picture> pictures;
  for (const auto& [format, scale, written] :
       {std::tuple{VoxelFormat::kU8, 255.0, false}, std::tuple{VoxelFormat::kU16, 65535.0, false},
        std::tuple{VoxelFormat::kU32, 1000.0, true}}) {
    VoxelizeResult result = EmptyResult({32, 32, 32});
    AddBits(result, Ball(16, 14));
    TargetSpec spec = Spec(format, 4, "base_color");
    if (written) spec.scale = scale;
    AddTarget(result, spec, result.grid.voxels(), red(scale));
    pictures.push_back(RenderPreview(result, kSmall).value());
    EXPECT_GT(MiddleMean(pictures.back(), 0), MiddleMean(pictures.back(), 1) + 60) << Name(format);
  }
  EXPECT_EQ(pictures[0].rgb, pictures[1].rgb);
}

TEST(RenderPreview, ColoursScalarIntegersByTheirRange) {
  const auto picture = [](VoxelFormat format, double scale) {
    VoxelizeResult result = EmptyResult({32, 32, 32});
    AddBits(result, Ball(16, 14));
    AddTarget(result, Spec(format, 1, "triangle_id", Blend::kMax), result.grid.voxels(),
              [&](uint64_t n, int) { return double(n / 32 % 32) * scale; });
    return RenderPreview(result, kSmall).value().rgb;
  };
  const auto expected = picture(VoxelFormat::kF32, 1);
  EXPECT_NE(expected, RenderPreview(BallResult(32, 14.0 / 32), kSmall).value().rgb);
  EXPECT_EQ(picture(VoxelFormat::kU8, 4), expected);
  EXPECT_EQ(picture(VoxelFormat::kU16, 1024), expected);
  EXPECT_EQ(picture(VoxelFormat::kU32, 1024), expected);
  EXPECT_EQ(picture(VoxelFormat::kF16, 16), expected);
}

TEST(UnpackNormal, IsWithinTheMapsStepOfTheNormalThatWasPacked) {
  double worst = 1;
  for (int theta = 0; theta <= 90; ++theta) {
    for (int phi = 0; phi < 180; ++phi) {
      const double t = theta * M_PI / 90, p = phi * M_PI / 90;
      const Vec3f n{float(std::sin(t) * std::cos(p)), float(std::sin(t) * std::sin(p)), float(std::cos(t))};
      const Vec3f back = UnpackNormal(PackNormal(n));
      EXPECT_NEAR(Dot(back, back), 1, 1e-6);
      worst = std::min(worst, double(Dot(n, back)));
    }
  }
  EXPECT_GT(worst, std::cos(1.2 * M_PI / 180));
}

TEST(RenderPreview, IsLitByPackedNormals) {
  // A flat wall, its stored normals turned towards the light or away from it.
  const auto wall = [](const Vec3f& normal, VoxelFormat format, Blend blend) {
    VoxelizeResult result = EmptyResult({32, 32, 32});
    AddBits(result, [](int64_t, int64_t, int64_t k) { return k >= 20; });
    AddTarget(result, Spec(format, 1, "packed_normal", blend), result.grid.voxels(),
              [&](uint64_t, int) { return double(PackNormal(normal)); });
    return RenderPreview(result, kSmall).value();
  };
  const Vec3f towards{0, 0.8f, 0.6f}, along{0.8f, -0.6f, 0};
  const Picture bright = wall(towards, VoxelFormat::kU16, Blend::kMax);
  EXPECT_GT(MiddleMean(bright, 1), MiddleMean(wall(along, VoxelFormat::kU16, Blend::kMax), 1) + 30);
  EXPECT_EQ(bright.rgb, wall(towards, VoxelFormat::kU32, Blend::kReplace).rgb);
  EXPECT_EQ(bright.rgb, wall(towards, VoxelFormat::kF32, Blend::kFirst).rgb);
  // A sum of packed normals is none.
  EXPECT_NE(bright.rgb, wall(towards, VoxelFormat::kU16, Blend::kAdd).rgb);
}

TEST(RenderPreview, RefusesArraysThatDoNotFitTheResult) {
  const auto refused = [](const VoxelizeResult& result, const std::string& array) {
    const absl::Status status = RenderPreview(result, kSmall).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << array;
    EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("'" + array + "'"));
  };
  const auto listed = [](ResultKind kind) {
    VoxelizeResult result = Listed(kind, {16, 16, 16}, Layout::kInterleaved, Ball(8, 5));
    AddTarget(result, Spec(VoxelFormat::kF32, 1, "constant"), PreviewItems(result).count(),
              [](uint64_t, int) { return 1.0; });
    return result;
  };
  VoxelizeResult sparse = listed(ResultKind::kSparse);
  ASSERT_TRUE(RenderPreview(sparse, kSmall).ok());
  reinterpret_cast<uint64_t*>(sparse.bricks.data())[sparse.listed_bricks() - 1] = 8;
  refused(sparse, "brick");
  sparse = listed(ResultKind::kSparse);
  sparse.masks.data()[0] ^= 1;
  refused(sparse, "target0");
  sparse = listed(ResultKind::kSparse);
  sparse.masks = BufferOf({1, 2});
  refused(sparse, "mask");
  VoxelizeResult buckets = listed(ResultKind::kBuckets);
  ASSERT_TRUE(RenderPreview(buckets, kSmall).ok());
  reinterpret_cast<uint64_t*>(buckets.voxels.data())[1] = 0;
  refused(buckets, "voxel");
  buckets = listed(ResultKind::kBuckets);
  reinterpret_cast<uint64_t*>(buckets.offsets.data())[1] = 1'000'000;
  refused(buckets, "offset");
}

}  // namespace
}  // namespace voxelpipe
