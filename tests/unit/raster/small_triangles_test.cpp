// The device's certain answers about small triangles, computed on the host: those of raster/spans.h, which every
// schedule shares.
#include "raster/filtered/small_triangle_tests.h"

#include <gtest/gtest.h>

#include <array>
#include <random>
#include <set>

#include "grid/index_space.h"
#include "raster/filtered/small_triangle_rows.h"
#include "raster/spans.h"

namespace voxelpipe {
namespace {

using Voxels = std::set<std::array<int, 3>>;
using Triangle = std::array<Vec3d, 3>;

constexpr int kDims = 64;

Voxels Exactly(const Triangle& t, Coverage coverage) {
  VoxelRange grid;
  for (int i = 0; i < 3; ++i) grid.end[i] = kDims;
  Voxels voxels;
  ForEachRowSpan(SetUpTriangle(t[0], t[1], t[2], coverage), grid,
                 [&](int64_t y, int64_t z, int64_t begin, int64_t end) {
                   for (int64_t x = begin; x < end; ++x) voxels.insert({int(x), int(y), int(z)});
                 });
  return voxels;
}

struct Answer {
  bool certain = false;
  Voxels voxels;
};

// The box that vertices are packed in.
struct Packing {
  Vec3d least, extent;
  PackedPlace place;
};

// `packing`: null for vertices as they are. `quickly`: octants by TouchedQuickly.
template <bool kThin>
Answer ByCells(const Triangle& world, const FixedPlace& place, const Packing* packing, bool quickly) {
  int v[3][3];
  for (int i = 0; i < 3; ++i) {
    for (int a = 0; a < 3; ++a) {
      const double p = world[size_t(i)][a];
      v[i][a] = packing == nullptr ? ToFixed(p, place.scale[a], place.offset[a], place.wall[a])
                                   : PackedToFixed(PackCoordinate(p, packing->least[a], PartOf(packing->extent[a])),
                                                   packing->place.scale[a], packing->place.offset[a], place.wall[a]);
    }
  }
  const FixedBox box = BoxOf(v, place);
  if (box.doubtful) return {};
  int begin[3], end[3], greatest = 0, single = 0;
  for (int a = 0; a < 3; ++a) {
    begin[a] = Max(box.first[a], 0);
    end[a] = Min(box.last[a] + 1, kDims);
    greatest = Max(greatest, box.last[a] - box.first[a]);
    single += box.last[a] == box.first[a];
  }
  Answer answer;
  if (greatest >= kMaxCells || (!kThin && single >= 2)) return {};  // for others, or nothing to decide
  if (greatest <= 1) {
    uint32_t in_box = 0xff;
    for (int a = 0; a < 3; ++a) in_box &= box.first[a] == box.last[a] ? ~HalfOf(a) : 0xff;
    const Octants o = kThin && single >= 2 ? TouchedThinRun(v, box, place)
                      : quickly            ? TouchedQuickly(v, box, in_box, place)
                                           : TouchedOctants<kThin>(v, box, in_box, place);
    answer.certain = !o.doubtful;
    for (int i = 0; i < 8; ++i) {
      const std::array<int, 3> at{box.first[0] + (i & 1), box.first[1] + (i >> 1 & 1), box.first[2] + (i >> 2)};
      bool inside = (o.touched >> i & 1) != 0;
      for (int a = 0; a < 3; ++a) inside = inside && at[size_t(a)] >= begin[a] && at[size_t(a)] < end[a];
      if (inside) answer.voxels.insert(at);
    }
    return answer;
  }
  std::array<CellSpan, kMaxCells> table;
  answer.certain =
      VisitCells<kThin>(v, box, begin, end, place, table.data(), 1, false, EachRow([&](int y, int z, int x, int count) {
                          for (int i = 0; i < count; ++i)
                            answer.voxels.insert({box.first[0] + x + i, begin[1] + y, begin[2] + z});
                        }));
  return answer;
}

struct Kind {
  const char* name;
  double reach;  // of a triangle about its middle, voxels
  double
      quantum;  // vertices on multiples of it: ties; 0: anywhere; below 0: many by the widening beyond a voxel's border
  double flatness;    // of 1: the third vertex so much nearer to the line of the others
  double most_doubt;  // share of the answers
};

class CellsTest : public ::testing::TestWithParam<Kind> {
 protected:
  template <bool kThin>
  void Compare(bool packed = false, bool quickly = false) {
    const Kind& kind = GetParam();
    const Vec3d origin{-3.7, 0.2, 11.3}, size{0.013, 0.0171, 0.02};
    const FixedPlace place = MakeFixedPlace({origin, size}, Vec3d{-8, -8, -8}, Vec3d{kDims + 8, kDims + 8, kDims + 8});
    ASSERT_GT(place.bits, 0);
    Packing packing;
    for (int a = 0; a < 3; ++a) {
      packing.least[a] = origin[a] - 8 * size[a];
      packing.extent[a] = (kDims + 16) * size[a];
    }
    packing.place = MakePackedPlace(place, origin, size, packing.least, packing.extent);
    std::mt19937_64 random(kThin ? 5 : 4);
    std::uniform_real_distribution<double> middle(-2, kDims + 2), about(-kind.reach, kind.reach);
    int answers = 0, certain = 0;
    for (int n = 0; n < 20'000; ++n) {
      Triangle world, index;
      const Vec3d at{middle(random), middle(random), middle(random)};
      for (Vec3d& p : index) {
        for (int a = 0; a < 3; ++a) {
          p[a] = at[a] + about(random);
          if (kind.quantum > 0) p[a] = std::round(p[a] / kind.quantum) * kind.quantum;
          if (kind.quantum < 0 && random() % 4 == 0) {
            const double beyond = kNarrowWidening + 2e-4 * about(random) / kind.reach;
            p[a] = std::round(p[a]) + (random() % 2 == 0 ? beyond : -beyond);
          }
        }
      }
      if (kind.flatness < 1) index[2] = (index[0] + index[1]) * 0.5 + (index[2] - at) * kind.flatness;
      for (size_t i = 0; i < 3; ++i) {
        for (int a = 0; a < 3; ++a) world[i][a] = origin[a] + index[i][a] * size[a];
        index[i] = WorldToIndex(origin, size, world[i]);
      }
      const Answer answer = ByCells<kThin>(world, place, packed ? &packing : nullptr, quickly);
      ++answers;
      if (!answer.certain) continue;
      ++certain;
      ASSERT_EQ(answer.voxels, Exactly(index, kThin ? Coverage::kThin : Coverage::kConservative))
          << kind.name << " " << n;
    }
    EXPECT_GT(certain, 0);
    doubt_ = 1 - double(certain) / answers;
  }
  double doubt_ = 1;
};

TEST_P(CellsTest, CertainConservativeVoxelsAreThoseOfTheRows) {
  Compare<false>();
}

TEST_P(CellsTest, SoAreThoseFoundQuickly) {
  Compare<false>();
  const double doubt = doubt_;
  Compare<false>(false, true);
  // If triangles are thin, or barely reach voxels, the filter leaves more uncertain.
  EXPECT_LE(doubt_, doubt + (GetParam().flatness < 1 || GetParam().quantum < 0 ? 0.15 : 0.001));
}

TEST_P(CellsTest, CertainThinVoxelsAreThoseOfTheRows) {
  Compare<true>();
  EXPECT_LE(doubt_, GetParam().most_doubt);
}

TEST_P(CellsTest, SoAreThoseOfPackedVertices) {
  Compare<false>(true);
  Compare<true>(true);
  EXPECT_LE(doubt_, GetParam().most_doubt);
}

INSTANTIATE_TEST_SUITE_P(Kinds, CellsTest,
                         ::testing::Values(Kind{"half", 0.5, 0, 1, 0.1}, Kind{"voxel", 1, 0, 1, 0.1},
                                           Kind{"several", 2.5, 0, 1, 0.2}, Kind{"ties", 1, 0.25, 1, 0.6},
                                           Kind{"ties of several", 2.5, 0.5, 1, 0.6},
                                           Kind{"on the lattice", 2, 1, 1, 0.9}, Kind{"slivers", 1.5, 0, 0.01, 1},
                                           Kind{"near the border of the class", 1, 0, 0.02, 1},
                                           Kind{"tiny", 0.01, 0, 1, 1}, Kind{"widened", 0.4, -1, 1, 1}));

TEST(PackedPlaceTest, VerticesAreOffByLessThanTwoUnits) {
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> share(0, 1);
  for (int n = 0; n < 20'000; ++n) {
    // Grids of up to some 30,000 voxels, meshes from far below a voxel to the grid's size, or flat, also beside it.
    const double most = std::exp2(15 * share(random));
    Vec3d origin, size, least, extent, first, last;
    for (int a = 0; a < 3; ++a) {
      size[a] = std::exp2(40 * share(random) - 20);
      origin[a] = (share(random) - 0.5) * 1e4 * size[a];
      first[a] = (2 * share(random) - 1) * most * 0.9;
      last[a] = n % 7 == a ? first[a] : first[a] + share(random) * (most * 0.9 - first[a]);
      least[a] = origin[a] + first[a] * size[a];
      extent[a] = n % 7 == a ? 0 : (last[a] - first[a]) * size[a];
    }
    const FixedPlace place = MakeFixedPlace({origin, size}, first, last);
    ASSERT_GT(place.bits, 0);
    const PackedPlace packed = MakePackedPlace(place, origin, size, least, extent);
    for (int a = 0; a < 3; ++a) {
      const double p = least[a] + share(random) * extent[a];
      const long double exact = (static_cast<long double>(p) - origin[a]) / size[a] * (1 << place.bits);
      const int found = PackedToFixed(PackCoordinate(p, least[a], PartOf(extent[a])), packed.scale[a], packed.offset[a],
                                      place.wall[a]);
      ASSERT_LT(std::fabs(double(exact - found)), 2) << n << " " << a;
    }
  }
}

TEST(VisitCellsTest, ATriangleThatIsSaidToTouchAllOfItsBoxHasAllRowsOfItThatAreInTheGrid) {
  const FixedPlace place = MakeFixedPlace({}, {}, {kDims, kDims, kDims});
  for (int axis = 0; axis < 3; ++axis) {
    // Four voxels along the axis, the first of them outside of the grid, and two along the next, of which a line from
    // corner to corner leaves some out.
    const int next = (axis + 1) % 3;
    int v[3][3], begin[3], end[3];
    for (int a = 0; a < 3; ++a) {
      const double from = a == axis ? -0.5 : 7.25, upto = a == axis ? 2.5 : a == next ? 8.75 : 7.75;
      for (int i = 0; i < 3; ++i)
        v[i][a] = ToFixed(i == 1 ? upto : from, place.scale[a], place.offset[a], place.wall[a]);
      begin[a] = a == axis ? 0 : 7;
      end[a] = a == axis ? 3 : a == next ? 9 : 8;
    }
    const FixedBox box = BoxOf(v, place);
    ASSERT_FALSE(box.doubtful);
    ASSERT_EQ(box.first[axis], -1);
    std::array<CellSpan, kMaxCells> table;
    Voxels voxels, expected;
    for (int i = 0; i < 6; ++i) {
      std::array<int, 3> at{7, 7, 7};
      at[size_t(axis)] = i % 3;
      at[size_t(next)] += i / 3;
      expected.insert(at);
    }
    EXPECT_TRUE(VisitCells<false>(v, box, begin, end, place, table.data(), 1, true,
                                  EachRow([&](int y, int z, int x, int count) {
                                    for (int i = 0; i < count; ++i)
                                      voxels.insert({box.first[0] + x + i, begin[1] + y, begin[2] + z});
                                  })));
    EXPECT_EQ(voxels, expected) << axis;
  }
}

TEST(WholeNumbersTest, AreTheNearestOfEitherSide) {
  for (const float v : {-3.0f, -2.5f, -0.0f, 0.0f, 0x1p-20f, 0.5f, 1.0f, 8.999999f, 9.000001f, 4.0e6f}) {
    const float above = WholeFrom(v), below = WholeUpto(v);
    EXPECT_EQ(IntOf(above), int(std::ceil(v))) << v;
    EXPECT_EQ(IntOf(below), int(std::floor(v))) << v;
    EXPECT_EQ(above - kToInteger, std::ceil(v)) << v;
    EXPECT_EQ(CountOf(below, above), IntOf(above) - IntOf(below) + 1) << v;
  }
  // Bounds that bound nothing stay beyond all others.
  EXPECT_GT(WholeFrom(1e30f), WholeUpto(9));
  EXPECT_LT(WholeUpto(-1e30f), WholeFrom(0));
}

TEST(BitsFromTest, AreSoManyFromOneOn) {
  EXPECT_EQ(BitsFrom(0, 0), 0u);
  EXPECT_EQ(BitsFrom(3, 2), 0x18u);
  EXPECT_EQ(BitsFrom(0, 32), ~0u);
  EXPECT_EQ(BitsFrom(30, 9), 0xc0000000u);  // those beyond the word are left out
}

TEST(FixedPlaceTest, MeshesThatReachTooFarHaveNone) {
  const Vec3d origin{}, size{1, 1, 1}, least{-1, -1, -1};
  EXPECT_EQ(MakeFixedPlace({origin, size}, least, Vec3d{40'000, 1, 1}).bits, 0);
  EXPECT_EQ(MakeFixedPlace({Vec3d{1e18, 0, 0}, size}, least, Vec3d{5, 1, 1}).bits, 0);
  EXPECT_GT(MakeFixedPlace({origin, size}, least, Vec3d{30'000, 1, 1}).bits, 0);
}

}  // namespace
}  // namespace voxelpipe
