#include "isolate/archive.h"

#include "base/vec.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

enum class Colour : uint8_t { kRed, kGreen, kBlue };

struct Thing {
  int32_t number = 0;
  bool flag = false;
  Colour colour = Colour::kRed;
  std::string name;
  std::vector<Vec3f> few, many;
  std::vector<std::string> list;
};

template <typename A, typename T>
void ThingFields(A& archive, T& thing) {
  archive.Value(thing.number);
  archive.Flag(thing.flag);
  archive.Enum(thing.colour, Colour::kBlue);
  archive.Text(thing.name);
  archive.Array(thing.few);
  archive.Array(thing.many);
  archive.Each(thing.list, 8, [](A& a, auto& text) { a.Text(text); });
}

Thing Sample() {
  Thing thing{7, true, Colour::kBlue, "seven", {{1, 2, 3}}, {}, {"a", "", "ccc"}};
  for (int i = 0; i < 300'000; ++i) thing.many.push_back({float(i), 1, 2});
  return thing;
}

struct Packed {
  std::vector<uint8_t> text, bulk;
};

Packed Write(const Thing& thing) {
  ArchiveWriter writer;
  ThingFields(writer, thing);
  Packed bytes{writer.text(), std::vector<uint8_t>(writer.bulk_bytes())};
  writer.CopyBulk(bytes.bulk.data());
  return bytes;
}

absl::Status Read(const Packed& bytes, Thing& thing) {
  ArchiveReader reader(bytes.text, bytes.bulk);
  ThingFields(reader, thing);
  return reader.Finish();
}

TEST(ArchiveTest, WhatIsWrittenIsRead) {
  const Thing thing = Sample();
  const Packed bytes = Write(thing);
  EXPECT_EQ(bytes.bulk.size(), thing.many.size() * sizeof(Vec3f)) << "large arrays lie apart";
  EXPECT_LT(bytes.text.size(), 200u);
  Thing read;
  ASSERT_TRUE(Read(bytes, read).ok());
  EXPECT_EQ(read.number, 7);
  EXPECT_TRUE(read.flag);
  EXPECT_EQ(read.colour, Colour::kBlue);
  EXPECT_EQ(read.name, "seven");
  EXPECT_EQ(read.few, thing.few);
  EXPECT_EQ(read.many, thing.many);
  EXPECT_EQ(read.list, thing.list);
}

TEST(ArchiveTest, ArraysBelowAndAboveTheBoundOfBulk) {
  for (const size_t bytes : {kMinBulkBytes - 1, kMinBulkBytes, kMinBulkBytes + 1}) {
    const std::vector<uint8_t> values(bytes, 5);
    ArchiveWriter writer;
    writer.Array(values);
    writer.Bytes(values);
    std::vector<uint8_t> bulk(writer.bulk_bytes());
    writer.CopyBulk(bulk.data());
    ArchiveReader reader(writer.text(), bulk);
    std::vector<uint8_t> read;
    std::span<const uint8_t> view;
    reader.Array(read);
    reader.View(view);
    ASSERT_TRUE(reader.Finish().ok()) << bytes;
    EXPECT_EQ(read, values);
    EXPECT_TRUE(std::equal(view.begin(), view.end(), values.begin(), values.end()));
  }
}

TEST(ArchiveTest, CutBytesAreRefused) {
  const Packed bytes = Write(Sample());
  for (size_t n = 0; n < bytes.text.size(); ++n) {
    Thing thing;
    EXPECT_FALSE(Read({{bytes.text.begin(), bytes.text.begin() + ptrdiff_t(n)}, bytes.bulk}, thing).ok()) << n;
  }
  Thing thing;
  EXPECT_FALSE(Read({bytes.text, {bytes.bulk.begin(), bytes.bulk.end() - 1}}, thing).ok());
  Packed more = bytes;
  more.text.push_back(0);
  EXPECT_FALSE(Read(more, thing).ok()) << "bytes are left over";
}

TEST(ArchiveTest, CountsAreNotBelieved) {
  for (const uint64_t count : {uint64_t{1} << 20, uint64_t{1} << 40, uint64_t{1} << 61, UINT64_MAX}) {
    ArchiveWriter writer;
    writer.Value(count);
    const auto refused = [&](auto read) {
      ArchiveReader reader(writer.text(), {});
      read(reader);
      return !reader.Finish().ok();
    };
    EXPECT_TRUE(refused([](ArchiveReader& reader) {
      std::vector<Vec3f> values;
      reader.Array(values);
      EXPECT_LT(values.capacity(), 1000u);
    }));
    EXPECT_TRUE(refused([](ArchiveReader& reader) {
      std::vector<std::string> list;
      reader.Each(list, 8, [](ArchiveReader& a, std::string& text) { a.Text(text); });
      EXPECT_LT(list.capacity(), 1000u);
    }));
    EXPECT_TRUE(refused([](ArchiveReader& reader) {
      std::string text;
      reader.Text(text);
    }));
    EXPECT_TRUE(refused([](ArchiveReader& reader) {
      std::span<const uint8_t> view;
      reader.View(view);
    }));
  }
}

TEST(ArchiveTest, FlagsAndEnumerationsOutOfRangeAreRefused) {
  ArchiveWriter writer;
  writer.Value(uint8_t{3});
  ArchiveReader flag(writer.text(), {});
  bool value = false;
  flag.Flag(value);
  EXPECT_FALSE(flag.Finish().ok());
  ArchiveReader colour(writer.text(), {});
  Colour which = Colour::kRed;
  colour.Enum(which, Colour::kBlue);
  EXPECT_FALSE(colour.Finish().ok());
}

}  // namespace
}  // namespace voxelpipe
