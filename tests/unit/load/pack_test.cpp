#include "load/pack.h"

#include <sys/stat.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "support/resources/temporary_directory.h"
#include "unit/load/charged_packing.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class PackTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(root_ / "model" / "sub");
    const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    triangle_.assign(reinterpret_cast<const char*>(positions), sizeof positions);
    Write("model/tri.bin", triangle_);
    Write("secret.bin", triangle_);
  }

  void Write(const std::string& name, const std::string& bytes) {
    std::ofstream(root_ / name, std::ios::binary) << bytes;
  }

  // A one-triangle glTF whose buffer is `uri`.
  static std::string Gltf(const std::string& uri, const std::string& more = "") {
    return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
           R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],)"
           R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],)"
           R"("bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":")" +
           uri + "\"}]" + more + "}";
  }

  absl::StatusOr<FileBytes> Pack(const std::string& gltf) {
    Write("model/m.gltf", gltf);
    absl::StatusOr<PackedMesh> packed = ReadAndPackMeshFile((root_ / "model" / "m.gltf").string());
    if (!packed.ok()) return packed.status();
    return std::move(packed->bytes);
  }

  uint64_t Triangles(std::span<const uint8_t> bytes) {
    const auto scene = LoadScene(bytes);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() ? CountTriangles(*scene) : 0;
  }

  const testing::TemporaryDirectory directory_;
  const fs::path root_ = directory_.path();
  std::string triangle_;
};

TEST_F(PackTest, SiblingsBecomeOneGlb) {
  Write("model/sub/a b.bin", triangle_);
  for (const char* uri : {"tri.bin", "./tri.bin", "sub/a%20b.bin", "sub/../tri.bin"}) {
    const auto packed = Pack(Gltf(uri));
    ASSERT_TRUE(packed.ok()) << packed.status();
    EXPECT_EQ(SniffMeshFormat(*packed), MeshFormat::kGlb);
    EXPECT_EQ(Triangles(*packed), 1u);
  }
}

// A few bytes of JSON could name a file thousands of times, and each was read and packed.
TEST_F(PackTest, AFileIsPackedOnceHoweverOftenItIsNamed) {
  const std::string picture(100'000, 'p');
  Write("model/a.png", picture);
  std::string images;
  for (int i = 0; i < 500; ++i)
    images += absl::StrCat(i == 0 ? "" : ",", R"({"uri":")", i % 2 == 0 ? "./" : "", "a.png\"}");
  const auto packed = Pack(Gltf("tri.bin", ",\"images\":[" + images + "]"));
  ASSERT_TRUE(packed.ok()) << packed.status();
  EXPECT_LT(packed->size(), picture.size() + 64'000);
  const auto scene = LoadScene(*packed);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->images.size(), 500u);
  for (const auto& image : scene->images) ASSERT_EQ(image->encoded.size(), picture.size());
}

TEST_F(PackTest, ABufferIsPackedOnceHoweverOftenItIsNamed) {
  Write("model/big.bin", triangle_ + std::string(100'000, 'b'));
  // Views of the last buffer of each file, each time with another length.
  std::string buffers = R"({"byteLength":36,"uri":"big.bin"})";
  for (int i = 0; i < 500; ++i) absl::StrAppend(&buffers, R"(,{"byteLength":)", 40 + i, R"(,"uri":"./big.bin"})");
  absl::StrAppend(&buffers, R"(,{"uri":"big.bin"})");
  std::string gltf = Gltf("big.bin");
  const std::string one = R"("buffers":[{"byteLength":36,"uri":"big.bin"}])";
  for (const char* view : {"0", "500", "501"}) {
    std::string text = gltf;
    text.replace(text.find(one), one.size(), "\"buffers\":[" + buffers + "]");
    text.replace(text.find("\"buffer\":0"), 10, absl::StrCat("\"buffer\":", view));
    const auto packed = Pack(text);
    ASSERT_TRUE(packed.ok()) << packed.status();
    EXPECT_LT(packed->size(), 2 * 100'000u);
    EXPECT_EQ(Triangles(*packed), 1u);
  }
  gltf.replace(gltf.find(one), one.size(),
               R"("buffers":[{"byteLength":36,"uri":"big.bin"},{"byteLength":200000,"uri":"big.bin"}])");
  EXPECT_THAT(std::string(Pack(gltf).status().message()),
              HasSubstr("buffer 1: byteLength 200000, but its data has 100036 bytes"));
}

TEST_F(PackTest, FilesThatAreNamedAreChargedAndTheJobIsPolled) {
  Write("model/big.bin", triangle_ + std::string(1 << 20, 'b'));
  testing::ExpectPackingIsChargedAndPolled(Gltf("big.bin"), root_ / "model");
}

TEST_F(PackTest, TwoBuffersAreRebased) {
  Write("model/other.bin", "xx" + triangle_);
  std::string gltf = Gltf("tri.bin");
  gltf.replace(gltf.find("\"bufferViews\":[{\"buffer\":0,"), 27, "\"bufferViews\":[{\"buffer\":1,\"byteOffset\":2,");
  gltf.insert(gltf.rfind("]"), R"(,{"byteLength":38,"uri":"other.bin"})");
  const auto packed = Pack(gltf);
  ASSERT_TRUE(packed.ok()) << packed.status();
  const auto mesh = Flatten(*LoadScene(*packed));
  ASSERT_TRUE(mesh.ok());
  EXPECT_EQ(mesh->positions[1], (Vec3d{1, 0, 0}));
}

TEST_F(PackTest, NothingOutsideTheDirectoryIsRead) {
  fs::create_symlink(root_ / "secret.bin", root_ / "model" / "link.bin");
  const std::string absolute = (root_ / "secret.bin").string();
  for (const std::string& uri :
       {std::string("../secret.bin"), std::string("sub/../../secret.bin"), absolute, "file://" + absolute,
        std::string("http://127.0.0.1:9/x.bin"), std::string("%2e%2e/secret.bin"), std::string("..\\\\secret.bin"),
        std::string("link.bin"), std::string("tri.bin%zz")}) {
    const auto packed = Pack(Gltf(uri));
    EXPECT_EQ(packed.status().code(), absl::StatusCode::kInvalidArgument) << uri << " " << packed.status();
    EXPECT_THAT(std::string(packed.status().message()), HasSubstr("buffer 0: URI '")) << uri;
  }
}

TEST_F(PackTest, FilesOutsideAreReadWhereTheyAreAllowed) {
  Write("outside.bin", triangle_);
  fs::create_symlink(root_ / "outside.bin", root_ / "model" / "link.bin");
  for (const char* uri : {"../outside.bin", "link.bin"}) {
    Write("model/m.gltf", Gltf(uri));
    const std::string path = (root_ / "model" / "m.gltf").string();
    const absl::Status refused = ReadAndPackMeshFile(path).status();
    EXPECT_THAT(std::string(refused.message()), HasSubstr((fs::canonical(root_) / "outside.bin").string())) << refused;
    const auto packed = ReadAndPackMeshFile(path, {}, nullptr, {true, {}});
    ASSERT_TRUE(packed.ok()) << packed.status();
    EXPECT_EQ(Triangles(packed->bytes), 1u);
  }
}

TEST_F(PackTest, AnImageOutsideIsRefusedByNameIfItIsWantedAndNeverWhite) {
  Write("picture.png", "\x89PNG and so on");
  fs::create_symlink(root_ / "picture.png", root_ / "model" / "link.png");
  for (const char* uri : {"../picture.png", "link.png"}) {
    Write("model/m.gltf", Gltf("tri.bin", std::string(R"(,"images":[{"uri":")") + uri +
                                              R"("}],"textures":[{"source":0}],)"
                                              R"("materials":[{"emissiveTexture":{"index":0}}])"));
    const std::string path = (root_ / "model" / "m.gltf").string();
    OutsideFiles outside;
    outside.wanted = {true, true, false};  // base colour, emissive
    const absl::Status refused = ReadAndPackMeshFile(path, {}, nullptr, outside).status();
    EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(refused.message()), HasSubstr("image 0: URI '")) << refused;
    EXPECT_THAT(std::string(refused.message()), HasSubstr((fs::canonical(root_) / "picture.png").string())) << refused;
    if (std::string(uri) == "link.png") {
      EXPECT_THAT(std::string(refused.message()), HasSubstr("the link '")) << refused;
    }
    outside.wanted = {true, false, true};  // no shader reads it
    EXPECT_TRUE(ReadAndPackMeshFile(path, {}, nullptr, outside).ok());
    outside.allowed = true;
    const auto scene = LoadScene(ReadAndPackMeshFile(path, {}, nullptr, outside)->bytes);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->images[0]->encoded.size(), 14u);
  }
}

TEST_F(PackTest, AFileThatCannotBeReadSaysWhyAndNamesItsUriOnce) {
  if (::geteuid() == 0) GTEST_SKIP() << "root reads everything";
  fs::permissions(root_ / "model" / "tri.bin", fs::perms::none);
  EXPECT_EQ(std::string(Pack(Gltf("tri.bin")).status().message()),
            (root_ / "model" / "m.gltf").string() + ": buffer 0: URI 'tri.bin': cannot be read: Permission denied");
}

TEST_F(PackTest, ErrorsBeginWithThePathOnce) {
  const std::string missing = (root_ / "none.glb").string();
  EXPECT_EQ(std::string(ReadAndPackMeshFile(missing).status().message()), missing + ": no such file");
  EXPECT_EQ(std::string(ReadAndPackMeshFile(root_.string()).status().message()),
            root_.string() + ": not a regular file");
  EXPECT_EQ(std::string(Pack(Gltf("none.bin")).status().message()),
            (root_ / "model" / "m.gltf").string() + ": buffer 0: URI 'none.bin': no such file");
}

TEST_F(PackTest, OnlyRegularFilesAreRead) {
  EXPECT_THAT(std::string(Pack(Gltf("sub")).status().message()), HasSubstr("not a regular file"));
  ASSERT_EQ(::mkfifo((root_ / "model" / "pipe").c_str(), 0600), 0);
  EXPECT_THAT(std::string(Pack(Gltf("pipe")).status().message()), HasSubstr("not a regular file"));
  EXPECT_EQ(ReadAndPackMeshFile(root_.string()).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(ReadAndPackMeshFile((root_ / "none.glb").string()).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(PackTest, AMissingBufferIsAnErrorAMissingImageIsNot) {
  EXPECT_EQ(Pack(Gltf("none.bin")).status().code(), absl::StatusCode::kNotFound);
  const auto packed = Pack(Gltf("tri.bin", R"(,"images":[{"uri":"none.png"}])"));
  ASSERT_TRUE(packed.ok()) << packed.status();
  EXPECT_EQ(Triangles(*packed), 1u);
}

TEST_F(PackTest, ImagesComeAlong) {
  Write("model/picture.png", "\x89PNG and so on");
  const auto packed =
      Pack(Gltf("tri.bin", R"(,"images":[{"uri":"picture.png"}],"textures":[{"source":0}],)"
                           R"("materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}])"));
  ASSERT_TRUE(packed.ok()) << packed.status();
  const auto scene = LoadScene(*packed);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->images.size(), 1u);
  EXPECT_EQ(scene->images[0]->encoded.size(), 14u);
}

TEST_F(PackTest, AViewThatOverrunsItsBufferIsRefusedNotGivenItsNeighbour) {
  std::string gltf = Gltf("tri.bin");
  gltf.replace(gltf.find("\"byteLength\":36}]"), 17, "\"byteLength\":40}]");
  EXPECT_THAT(std::string(Pack(gltf).status().message()), HasSubstr("bufferView 0: overruns buffer 0 of 36 bytes"));
  gltf = Gltf("tri.bin");
  gltf.replace(gltf.rfind("\"byteLength\":36"), 15, "\"byteLength\":99");
  EXPECT_THAT(std::string(Pack(gltf).status().message()), HasSubstr("buffer 0: byteLength 99"));
}

TEST_F(PackTest, WhatIsNoGltfGoesToTheLoaderAsItIs) {
  for (const std::string& text : {std::string("{ not json"), std::string(100000, '['), std::string("[]"),
                                  std::string(R"({"buffers":7,"images":[1]})"), std::string()}) {
    const auto packed = Pack(text);
    ASSERT_TRUE(packed.ok()) << packed.status();
    EXPECT_EQ(packed->size(), text.size());
    EXPECT_FALSE(LoadScene(*packed).ok());
  }
}

TEST_F(PackTest, TheNameTellsTheFormatWhereTheContentDoesNot) {
  const std::string off = "3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  const auto packed = [&](const std::string& name, const std::string& text) {
    Write(name, text);
    return ReadAndPackMeshFile((root_ / name).string());
  };
  const auto bare = packed("bare.off", off);
  ASSERT_TRUE(bare.ok()) << bare.status();
  EXPECT_EQ(bare->format, MeshFormat::kOff);
  EXPECT_EQ(CountTriangles(*LoadScene(bare->bytes, bare->format)), 1u);
  EXPECT_EQ(packed("whole.off", "OFF\n" + off)->format, MeshFormat::kAuto);
  EXPECT_EQ(packed("wrong.stl", "OFF\n" + off)->format, MeshFormat::kAuto) << "the content decides";
  EXPECT_EQ(packed("bare.txt", off)->format, MeshFormat::kAuto);
}

TEST_F(PackTest, SizeLimit) {
  LoadLimits limits;
  limits.max_file_bytes = 35;
  EXPECT_EQ(ReadAndPackMeshFile((root_ / "model" / "tri.bin").string(), limits).status().code(),
            absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace voxelpipe
