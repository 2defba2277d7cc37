// What WriteResult wrote is read back, and what is no result is refused with place and reason.
#include "encode/read/stored_result.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "encode/encode.h"
#include "encode/npy.h"
#include "encode/zip_writer.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using testing::EmptyResult;
using ::testing::HasSubstr;
using testing::ReadFile;
using testing::SampleBit;
using testing::SampleValue;
using testing::TemporaryDirectory;

using Shape = std::vector<uint64_t>;

class StoredResults : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    const std::string path = directory_ / name;
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }
  std::string ErrorOf(const std::string& path) {
    const absl::StatusOr<StoredResult> result = OpenResult(path);
    return result.ok() ? "" : std::string(result.status().message());
  }
  static std::string TextOf(const std::string& path) {
    const std::vector<uint8_t> bytes = ReadFile(path);
    return {bytes.begin(), bytes.end()};
  }
  // A .npz of these entries.
  std::string Archive(const std::string& name, const std::vector<std::pair<std::string, std::string>>& entries) {
    AtomicFile file = AtomicFile::Create(directory_ / name).value();
    ZipWriter zip(file, nullptr);
    for (const auto& [entry, bytes] : entries) {
      EXPECT_TRUE(zip.BeginEntry(entry, bytes.size()).ok());
      EXPECT_TRUE(zip.Write({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}).ok());
      EXPECT_TRUE(zip.EndEntry().ok());
    }
    EXPECT_TRUE(zip.Finish().ok());
    EXPECT_TRUE(file.Commit().ok());
    return directory_ / name;
  }
  template <typename T>
  static std::string Npy(const std::string& descr, const Shape& shape, const std::vector<T>& values) {
    return NpyHeader(descr, shape) +
           std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }

  TemporaryDirectory directory_;
};

TEST_F(StoredResults, DenseResultsOfAllFormatsHoldTheSameNumbers) {
  for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
    VoxelizeResult result = EmptyResult({9, 7, 5}, layout);
    result.grid.origin = {-1, 0.1, 2};
    result.grid.voxel_size = {0.5, 0.25, 2};
    AddBits(result, SampleBit);
    AddFloats(result, 3, SampleValue);
    for (const char* name : {"out.raw", "out.npz"}) {
      ASSERT_TRUE(WriteResult(result, directory_ / name).ok());
      const absl::StatusOr<StoredResult> stored = OpenResult(directory_ / name);
      ASSERT_TRUE(stored.ok()) << stored.status();
      EXPECT_EQ(stored->kind, ResultKind::kDense);
      EXPECT_EQ(stored->dims, result.grid.dims);
      EXPECT_EQ(stored->place->origin, result.grid.origin);
      EXPECT_EQ(stored->place->voxel_size, result.grid.voxel_size);
      ASSERT_EQ(stored->targets.size(), 2u);
      EXPECT_EQ(stored->targets[1].components, 3);
      EXPECT_EQ(stored->targets[1].planar, layout == Layout::kPlanar);
      ArrayReader bits(stored->targets[0].array), values(stored->targets[1].array);
      for (int64_t k = 0; k < 5; ++k) {
        for (int64_t j = 0; j < 7; ++j) {
          for (int64_t i = 0; i < 9; ++i) {
            double bit = 0, value = 0;
            ASSERT_TRUE(bits.Next(bit).ok());
            ASSERT_EQ(bit, SampleBit(i, j, k)) << name;
            if (layout == Layout::kPlanar) continue;
            for (int c = 0; c < 3; ++c) {
              ASSERT_TRUE(values.Next(value).ok());
              ASSERT_EQ(value, SampleValue(i, j, k, c)) << name;
            }
          }
        }
      }
    }
  }
}

TEST_F(StoredResults, ANpyHasDimsAndNoPlace) {
  VoxelizeResult result = EmptyResult({9, 7, 5});
  AddFloats(result, 3, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory_ / "out.npy").ok());
  const absl::StatusOr<StoredResult> stored = OpenResult(directory_ / "out.npy");
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_EQ(stored->dims, result.grid.dims);
  EXPECT_FALSE(stored->place);
  EXPECT_EQ(stored->targets[0].components, 3);
}

TEST_F(StoredResults, AReaderBeginsAndSkipsWhereItIsTold) {
  std::vector<uint16_t> numbers(100'000);
  for (size_t i = 0; i < numbers.size(); ++i) numbers[i] = uint16_t(i);
  const std::string path = Write("a.npy", Npy("<u2", {100, 100, 10}, numbers));
  const absl::StatusOr<StoredResult> stored = OpenResult(path);
  ASSERT_TRUE(stored.ok()) << stored.status();
  ArrayReader reader(stored->targets[0].array, 77);
  int64_t value = 0;
  ASSERT_TRUE(reader.NextInteger(value).ok());
  EXPECT_EQ(value, 77);
  reader.Skip(50'000);
  ASSERT_TRUE(reader.NextInteger(value).ok());
  EXPECT_EQ(value, 50'078);
}

TEST_F(StoredResults, ANpyThatIsNoneIsRefusedWithTheReason) {
  const std::string good = Npy<uint8_t>("|u1", {1, 2, 2}, {0, 1, 2, 3});
  EXPECT_EQ(ErrorOf(Write("good.npy", good)), "");
  const auto refused = [&](const std::string& bytes) { return ErrorOf(Write("bad.npy", bytes)); };
  EXPECT_THAT(refused(""), HasSubstr("bad.npy: too short"));
  EXPECT_THAT(refused(std::string(100, 'x')), HasSubstr("does not begin with"));
  EXPECT_THAT(refused(good.substr(0, 60)), HasSubstr("ends within its header"));
  EXPECT_THAT(refused(good.substr(0, good.size() - 1)), HasSubstr("needs 4 bytes, there are 3"));
  EXPECT_THAT(refused(good + "x"), HasSubstr("needs 4 bytes, there are 5"));
  std::string changed = good;
  changed[6] = 9;
  EXPECT_THAT(refused(changed), HasSubstr("version 9.0"));
  changed = good;
  changed.replace(changed.find("False"), 5, "True ");
  EXPECT_THAT(refused(changed), HasSubstr("Fortran"));
  changed = good;
  changed.replace(changed.find("|u1"), 3, "|O8");
  EXPECT_THAT(refused(changed), HasSubstr("'|O8'"));
  changed = good;
  changed.replace(changed.find("shape"), 5, "shake");
  EXPECT_THAT(refused(changed), HasSubstr("not NumPy's"));
  EXPECT_THAT(refused(Npy<uint8_t>("|u1", {4}, {0, 1, 2, 3})), HasSubstr("(4), not (nz, ny, nx)"));
  EXPECT_THAT(refused(Npy<uint8_t>("|u1", {1, 1, 1, 1, 4}, {0, 1, 2, 3})), HasSubstr("not (nz, ny, nx)"));
  EXPECT_THAT(refused(Npy<uint8_t>("|u1", {1, 0, 1}, {})), HasSubstr("dims"));
  EXPECT_THAT(refused(NpyHeader("|u1", {uint64_t{1} << 40, uint64_t{1} << 40, 1})), HasSubstr("too many elements"));
  EXPECT_THAT(refused(NpyHeader("<f8", {uint64_t{1} << 61, 1, 1})), HasSubstr("too many elements"));
}

TEST_F(StoredResults, AnArchiveThatIsNoneIsRefusedWithTheReason) {
  VoxelizeResult result = EmptyResult({4, 3, 2});
  AddBits(result, SampleBit);
  ASSERT_TRUE(WriteResult(result, directory_ / "good.npz").ok());
  const std::string good = TextOf(directory_ / "good.npz");
  const auto refused = [&](const std::string& bytes) { return ErrorOf(Write("bad.npz", bytes)); };
  EXPECT_THAT(refused("PK"), HasSubstr("bad.npz: too short"));
  EXPECT_THAT(refused(good.substr(0, good.size() / 2)), HasSubstr("may be cut off"));
  std::string changed = good;
  const size_t header = changed.find("PK\x01\x02");
  changed[header + 10] = 8;  // method
  EXPECT_THAT(refused(changed), HasSubstr("'dims.npy') is compressed"));
  changed = good;
  changed[header + 8] |= 1;
  EXPECT_THAT(refused(changed), HasSubstr("encrypted"));
  changed = good;
  changed[changed.find("PK\x03\x04")] = 'Q';
  EXPECT_THAT(refused(changed), HasSubstr("has no header at byte 0"));
  // Every byte of the directory changed: read or refused, and never out of bounds.
  for (size_t at = header; at < good.size(); ++at) {
    changed = good;
    changed[at] = char(changed[at] ^ 0x55);
    ErrorOf(Write("bad.npz", changed));
  }
}

TEST_F(StoredResults, ListsHaveToFitTheGridAndEachOther) {
  const std::string dims = Npy<int64_t>("<i8", {3}, {4, 4, 4});
  const std::string place = Npy<double>("<f8", {3}, {1, 1, 1});
  const std::vector<std::pair<std::string, std::string>> head = {
      {"dims.npy", dims}, {"origin.npy", place}, {"voxel_size.npy", place}};
  const auto error = [&](std::vector<std::pair<std::string, std::string>> more) {
    more.insert(more.begin(), head.begin(), head.end());
    return ErrorOf(Archive("a.npz", more));
  };
  const std::string ijk = Npy<int32_t>("<i4", {2, 3}, {0, 0, 0, 1, 0, 0});
  const std::string values = Npy<uint8_t>("|u1", {2}, {1, 2});
  EXPECT_EQ(error({{"ijk.npy", ijk}, {"target0.npy", values}}), "");
  EXPECT_THAT(error({}), HasSubstr("no array 'target0'"));
  EXPECT_THAT(error({{"ijk.npy", ijk}, {"target0.npy", Npy<uint8_t>("|u1", {3}, {1, 2, 3})}}),
              HasSubstr("target0.npy: shape (3) does not fit (2)"));
  EXPECT_THAT(error({{"ijk.npy", Npy<int32_t>("<i4", {3, 2}, {0, 0, 0, 1, 0, 0})}, {"target0.npy", values}}),
              HasSubstr("ijk.npy: '<i4' of shape (3, 2), not '<i4' of (3, 3)"));
  EXPECT_THAT(error({{"ijk.npy", ijk}, {"offsets.npy", Npy<int64_t>("<i8", {1}, {0})}, {"target0.npy", values}}),
              HasSubstr("offsets.npy"));
  EXPECT_THAT(error({{"ijk.npy", ijk}, {"ijk.npy", ijk}}), HasSubstr("has the name of another"));
  EXPECT_THAT(ErrorOf(Archive("b.npz", {{"dims.npy", Npy<int64_t>("<i8", {3}, {4, 0, 4})},
                                        {"origin.npy", place},
                                        {"voxel_size.npy", place}})),
              HasSubstr("dims of 1 to"));
}

TEST_F(StoredResults, ADescriptionNamesFilesBesideItOfItsSizes) {
  VoxelizeResult result = EmptyResult({4, 3, 2});
  AddBits(result, SampleBit);
  AddFloats(result, 1, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory_ / "out.raw").ok());
  EXPECT_EQ(ErrorOf(directory_ / "out.raw"), "");
  EXPECT_EQ(ErrorOf(directory_ / "out.raw.json"), "");
  EXPECT_THAT(ErrorOf(directory_ / "out.0.raw"), HasSubstr("give OUT.raw, not OUT.0.raw"));
  const std::string about = TextOf(directory_ / "out.raw.json");
  const auto refused = [&](const std::string& from, const std::string& to) {
    std::string changed = about;
    changed.replace(changed.find(from), from.size(), to);
    return ErrorOf(Write("out.raw.json", changed));
  };
  EXPECT_THAT(refused("out.0.raw", "../out.0.raw"), HasSubstr("not the name of a file beside it"));
  EXPECT_THAT(refused("\"dtype\": \"bit\"", "\"dtype\": \"<f4\""), HasSubstr("3 bytes, its description needs 96"));
  EXPECT_THAT(refused("\"dims\"", "\"dimensions\""), HasSubstr("not the description of a .raw"));
  EXPECT_THAT(refused("{", "["), HasSubstr("not the description of a .raw"));
}

TEST_F(StoredResults, OtherFilesAreRefused) {
  EXPECT_THAT(ErrorOf(directory_ / "none.npy"), HasSubstr("none.npy: no such file"));
  EXPECT_THAT(ErrorOf(directory_ / "a.png"), HasSubstr("not a result"));
  std::filesystem::create_directory(directory_ / "d.npy");
  EXPECT_THAT(ErrorOf(directory_ / "d.npy"), HasSubstr("not a regular file"));
}

}  // namespace
}  // namespace voxelpipe
