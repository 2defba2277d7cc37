// A file that is being loaded for a job that ends.
#include "load/load_job.h"

#include <gtest/gtest.h>

#include "load/gltf/document/gltf_buffers.h"
#include "load/gltf/document/gltf_document.h"
#include "load/gltf/geometry/gltf_accessor.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

using testing::GlbBuilder;

TEST(LoadJobTest, EndsWithItsJob) {
  const testing::ByteVector glb = testing::TexturedQuadGlb();
  JobContext job;
  const absl::StatusOr<Scene> scene = LoadSceneFor(job, glb);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->images.size(), 1u);
  job.Cancel();
  EXPECT_EQ(LoadSceneFor(job, glb).status(), job.Check());
  JobContext late;
  late.set_deadline(JobContext::Clock::now());
  EXPECT_EQ(LoadSceneFor(late, glb).status(), late.Check());
  EXPECT_TRUE(LoadScene(glb).ok());
}

// A fault of the file does not hide the end of the job.
TEST(LoadJobTest, TheEndOfTheJobComesBeforeTheFaultsOfTheFile) {
  GlbBuilder builder;
  builder.Scene(
      {builder.Node({{"mesh", builder.Mesh(builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 7}))}})});
  JobContext job;
  EXPECT_EQ(LoadSceneFor(job, builder.Glb()).status().code(), absl::StatusCode::kInvalidArgument);
  job.Cancel();
  EXPECT_EQ(LoadSceneFor(job, builder.Glb()).status().code(), absl::StatusCode::kCancelled);
}

TEST(LoadJobTest, ACancelledJobReadsNoFurtherAccessor) {
  GlbBuilder builder;
  const int positions = builder.Positions({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  const int indices = builder.Indices({0, 1, 2});
  JobContext job;
  const LoadLimits limits;
  builder.doc["buffers"] = {{{"byteLength", builder.bin.size()}}};
  absl::StatusOr<gltf::Document> document = gltf::ParseDocument(job, builder.doc.dump(), limits);
  ASSERT_TRUE(document.ok()) << document.status();
  gltf::Budget budget(job, limits, builder.bin.size());
  absl::StatusOr<gltf::Buffers> buffers = gltf::Buffers::Resolve(*document, builder.bin, budget);
  ASSERT_TRUE(buffers.ok()) << buffers.status();
  const gltf::AccessorReader accessors(*document, *buffers, budget);
  ASSERT_TRUE(accessors.Vectors<Vec3f>(uint32_t(positions)).ok());
  job.Cancel();
  EXPECT_EQ(accessors.Unsigned(uint32_t(indices)).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace voxelpipe
