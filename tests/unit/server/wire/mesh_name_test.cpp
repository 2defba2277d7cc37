#include "wire/mesh_name.h"

#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

const std::vector<uint8_t> kAbc = {'a', 'b', 'c'};
// By the standard of the hash.
constexpr char kPlain[] = "meshes/ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

TEST(MeshNameTest, IsTheHashOfTheBytesAndWhatWasGivenWithThem) {
  EXPECT_EQ(MeshNameOf(kAbc, {}), kPlain);
  EXPECT_EQ(MeshNameOf(kAbc, {MeshFormat::kAuto, LengthUnit::kMillimetre}), std::string(kPlain) + "-mm");
  EXPECT_EQ(MeshNameOf(kAbc, {MeshFormat::kObj, LengthUnit::kNone}), std::string(kPlain) + "-obj");
  EXPECT_EQ(MeshNameOf(kAbc, {MeshFormat::kStl, LengthUnit::kInch}), std::string(kPlain) + "-in-stl");
}

TEST(MeshNameTest, EveryNameIsAnotherAndPasses) {
  std::set<std::string> names;
  size_t made = 0;
  for (const MeshFormat format :
       {MeshFormat::kAuto, MeshFormat::kGlb, MeshFormat::kGltf, MeshFormat::kDraco, MeshFormat::kStl, MeshFormat::kPly,
        MeshFormat::kOff, MeshFormat::kObj, MeshFormat::k3mf}) {
    for (const LengthUnit unit :
         {LengthUnit::kNone, LengthUnit::kMillimetre, LengthUnit::kCentimetre, LengthUnit::kMetre, LengthUnit::kInch}) {
      const std::string name = MeshNameOf(kAbc, {format, unit});
      EXPECT_TRUE(CheckMeshName(name, "name").ok()) << name;
      names.insert(name);
      ++made;
    }
  }
  EXPECT_EQ(names.size(), made);
}

TEST(MeshNameTest, OtherTextsAreRefusedByField) {
  const std::string digits(64, '0');
  for (const std::string& wrong :
       {std::string(), std::string("meshes/"), digits, "meshes/" + digits + "0", "meshes/" + std::string(63, '0'),
        "meshes/" + std::string(64, 'A'), "meshes/" + std::string(64, 'g'), "Meshes/" + digits, "/meshes/" + digits,
        "meshes/" + digits + "-", "meshes/" + digits + "-km", "meshes/" + digits + "-obj-mm",
        "meshes/" + digits + "-mm-mm", "meshes/" + digits + "-mm-", "meshes/" + digits + "-obj-obj",
        "meshes/" + digits + "-objx", "meshes/" + digits + " ", std::string("meshes/../etc/passwd")}) {
    const absl::Status status = CheckMeshName(wrong, "upload.expected_id");
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << wrong;
    EXPECT_TRUE(std::string(status.message()).starts_with("upload.expected_id: ")) << status;
  }
}

}  // namespace
}  // namespace voxelpipe
