// A file to a flattened mesh, step by step.
#include "load/load_mesh.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "mesh/mesh_bytes.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

TEST(LoadMeshTest, GivesTheFileBackBeforeItFlattens) {
  const testing::ByteVector glb = testing::TexturedQuadGlb();
  std::vector<std::string> events;
  const JobContext job([&](std::string_view stage, double fraction) {
    events.push_back(std::string(stage) + (fraction == 0 ? " begins" : " ends"));
  });
  const absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(job, glb, {}, [&] { events.push_back("file used"); });
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  EXPECT_EQ(events,
            (std::vector<std::string>{"load begins", "file used", "load ends", "flatten begins", "flatten ends"}));
  EXPECT_EQ(loaded->mesh.triangles.size(), 2u);
  EXPECT_EQ(loaded->contents.format, "glb");
  EXPECT_EQ(loaded->contents.file_bytes, glb.size());
  EXPECT_GE(loaded->peak_bytes, MeshBytes(loaded->mesh));
}

TEST(LoadMeshTest, DecodesTheTexturesThatAreAskedFor) {
  const testing::ByteVector glb = testing::TexturedQuadGlb();
  const JobContext job;
  for (const bool base_color : {false, true}) {
    TextureUse use;
    use.base_color = base_color;
    const absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(job, glb, {.textures = use});
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    ASSERT_EQ(loaded->mesh.images.size(), 1u);
    EXPECT_EQ(loaded->mesh.images[0]->rgba.empty(), !base_color);
  }
}

TEST(LoadMeshTest, EndsWithItsJobAndAtTheFirstFault) {
  JobContext job;
  bool used = false;
  const auto load = [&](const testing::ByteVector& file) { return LoadMeshFor(job, file, {}, [&] { used = true; }); };
  EXPECT_EQ(load({1, 2, 3, 4, 5}).status().code(), absl::StatusCode::kInvalidArgument);
  job.Cancel();
  EXPECT_EQ(load(testing::TexturedQuadGlb()).status(), job.Check());
  EXPECT_FALSE(used);
}

}  // namespace
}  // namespace voxelpipe
