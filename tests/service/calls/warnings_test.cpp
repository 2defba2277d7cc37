// Warnings reach the client, whatever the call.
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "inspect.h"
#include "many_stream.h"
#include "service/support/batch_fixture.h"
#include "support/meshes/glb_builder.h"
#include "support/warnings.h"
#include "wire/response.h"

namespace voxelpipe::testing {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// A cube without scenes, whose texture is a file that was not sent.
std::vector<uint8_t> FaultyGlb() {
  GlbBuilder builder;
  const Shape cube = CubeShape();
  json primitive = builder.Primitive(cube.positions, cube.indices);
  primitive["attributes"]["TEXCOORD_0"] = builder.Vectors(std::vector<float>(16, 0.5f), "VEC2");
  primitive["material"] = 0;
  builder.Node({{"mesh", builder.Mesh(primitive)}});
  builder.doc["images"] = {{{"uri", "gone.png"}}};
  builder.doc["textures"] = {{{"source", 0}}};
  builder.doc["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  return builder.Glb();
}

VoxelizeRequest Colours() {
  VoxelizeRequest request = SmallRequest();
  request.targets[0].format = VoxelFormat::kU8;
  request.targets[0].components = 4;
  request.targets[0].blend = Blend::kReplace;
  request.targets[0].shader = {"base_color", {}};
  return request;
}

const std::vector<std::string> kBoth = {"no_scene", "texture_missing"};

class WarningsTest : public BatchTest {
 protected:
  const std::vector<uint8_t> faulty_ = FaultyGlb();
  const JobContext job_;
};

TEST_F(WarningsTest, OfEachWayToCall) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto small = client_->Voxelize(faulty_, MeshFormat::kAuto, Colours(), job_);
  ASSERT_TRUE(small.ok()) << small.status();
  EXPECT_EQ(Codes(small->stats.warnings), kBoth);
  EXPECT_THAT(Lines(small->stats.warnings)[1], HasSubstr("image 0: the URI 'gone.png'"));

  VoxelizeRequest large = Colours();
  large.grid.resolution = 96;  // more than one message holds
  const auto streamed = client_->Voxelize(faulty_, MeshFormat::kAuto, large, job_);
  ASSERT_TRUE(streamed.ok()) << streamed.status();
  EXPECT_EQ(Codes(streamed->stats.warnings), kBoth);

  const v1::VoxelizeRequest message = RequestOf(Colours(), faulty_);
  EXPECT_EQ(Codes(ReadWarnings(Call(*stub_, message).summary)), kBoth);
  EXPECT_EQ(Codes(ReadWarnings(CallUpload(*stub_, message).summary)), kBoth);

  ASSERT_TRUE(Send(JobOf(1, message)));
  stream_->WritesDone();
  EXPECT_TRUE(Finish().ok());
  EXPECT_EQ(Codes(ReadWarnings(answers_[1].summary)), kBoth);
}

TEST_F(WarningsTest, OfTexturesOnlyWhereTheyAreRead) {
  ASSERT_NO_FATAL_FAILURE(Start());
  const auto plain = client_->Voxelize(faulty_, MeshFormat::kAuto, SmallRequest(), job_);
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_THAT(Codes(plain->stats.warnings), ElementsAre("no_scene"));
  const auto fine = client_->Voxelize(glb_, MeshFormat::kAuto, Colours(), job_);
  ASSERT_TRUE(fine.ok()) << fine.status();
  EXPECT_THAT(Codes(fine->stats.warnings), IsEmpty());
  const auto seen = InspectMesh(server_->address(), {}, faulty_, MeshFormat::kAuto, job_);
  ASSERT_TRUE(seen.ok()) << seen.status();
  EXPECT_EQ(Codes(seen->warnings), kBoth) << "who asks about the mesh is told of all";
}

TEST_F(WarningsTest, OfKeptMeshesWithEachUseAndOfKeptResults) {
  ASSERT_NO_FATAL_FAILURE(Start({"--result-cache-bytes", "16MiB"}));
  const auto stored = client_->UploadMesh(faulty_, MeshFormat::kAuto, job_);
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_EQ(Codes(stored->warnings), kBoth);
  const auto known = client_->GetMesh(stored->name);
  ASSERT_TRUE(known.ok()) << known.status();
  EXPECT_EQ(known->warnings, stored->warnings);
  for (int use = 0; use < 3; ++use) {
    const auto result = client_->VoxelizeStored(stored->name, Colours(), job_);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(Codes(result->stats.warnings), kBoth) << "use " << use;
    EXPECT_EQ(result->cached, use > 0);
    const auto plain = client_->VoxelizeStored(stored->name, SmallRequest(), job_);
    ASSERT_TRUE(plain.ok()) << plain.status();
    EXPECT_THAT(Codes(plain->stats.warnings), ElementsAre("no_scene"));
  }
  // A result that was kept for a lenient request is none for a strict one.
  VoxelizeRequest strict = Colours();
  strict.strict = true;
  EXPECT_EQ(client_->VoxelizeStored(stored->name, strict, job_).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(WarningsTest, StrictSaysWhatTheSameRequestSaysInThisProcess) {
  ASSERT_NO_FATAL_FAILURE(Start());
  VoxelizeRequest strict = Colours();
  strict.strict = true;
  const absl::Status status = client_->Voxelize(faulty_, MeshFormat::kAuto, strict, job_).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message(), "the file has no scenes: all nodes without a parent are used");
  const auto fine = client_->Voxelize(glb_, MeshFormat::kAuto, strict, job_);
  EXPECT_TRUE(fine.ok()) << fine.status();
}

}  // namespace
}  // namespace voxelpipe::testing
