// A mesh gives the same bytes alone, as one of several inputs, beside others that run at the same time, after others in
// the same process, and as one scene of a file that has several.
#include <fstream>
#include <sstream>
#include <thread>

#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "support/json/json.h"
#include "support/meshes/glb_builder.h"
#include "support/run.h"
#include "unit/cli/cli_runner.h"
#ifdef VOXELPIPE_HAVE_SERVICE
#include "service/support/server_process.h"
#endif

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::ByteVector;
using testing::GlbBuilder;
using testing::ParseJson;
struct Kind {
  std::string name;
  std::vector<std::string> options;  // of the command line
};

void PrintTo(const Kind& kind, std::ostream* out) {
  *out << kind.name;
}

std::vector<Kind> Kinds() {
  return {
      {"bits", {}},
      {"thin_bits_filled", {"--coverage", "thin", "--fill", "parity"}},
      {"flooded", {"--fill", "flood"}},
      {"f32", {"--target", "f32x3:add:shader=normal"}},
      {"several_targets", {"--target", "u32:replace:shader=triangle_id", "--target", "f16:average:shader=barycentric"}},
      {"sparse", {"--result", "sparse", "--target", "u32:first:shader=triangle_id"}},
      {"buckets", {"--result", "buckets", "--target", "f32x2:replace:shader=barycentric"}},
  };
}

std::vector<ByteVector> Meshes() {
  return {testing::TorusGlb(24, 16), testing::IcosphereGlb(2), testing::CubeGlb(3), testing::TorusGlb(7, 5)};
}

class AloneInList : public ::testing::TestWithParam<Kind> {
 protected:
  AloneInList() {
    for (const ByteVector& glb : Meshes()) {
      paths_.push_back(directory_ / ("mesh" + std::to_string(paths_.size()) + ".glb"));
      std::ofstream(paths_.back(), std::ios::binary)
          .write(reinterpret_cast<const char*>(glb.data()), std::streamsize(glb.size()));
    }
  }

  // The hashes of one command over these inputs, by input.
  std::map<std::string, std::string> Hashes(const std::vector<std::string>& inputs,
                                            const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"voxelize", "--resolution", "31", "--json"};
    for (const auto& list : {GetParam().options, more, inputs})
      arguments.insert(arguments.end(), list.begin(), list.end());
    const testing::CliOutcome outcome = testing::RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    std::map<std::string, std::string> hashes;
    std::istringstream lines(outcome.out);
    for (std::string line; std::getline(lines, line);) {
      const json summary = ParseJson(line);
      hashes[summary["input"]] = summary["hash"];
    }
    EXPECT_EQ(hashes.size(), inputs.size());
    return hashes;
  }

  std::map<std::string, std::string> AloneHashes() {
    std::map<std::string, std::string> hashes;
    for (const std::string& path : paths_) hashes.merge(Hashes({path}));
    return hashes;
  }

  const testing::TemporaryDirectory directory_;
  std::vector<std::string> paths_;
};

TEST_P(AloneInList, OfTheCommandLine) {
  const auto alone = AloneHashes();
  ASSERT_EQ(alone.size(), paths_.size());
  EXPECT_NE(alone.at(paths_[0]), alone.at(paths_[1]));
  EXPECT_EQ(Hashes(paths_), alone);
  EXPECT_EQ(Hashes({paths_.rbegin(), paths_.rend()}), alone);
}

#ifdef VOXELPIPE_HAVE_SERVICE
TEST_P(AloneInList, OfTheServer) {
  const auto server = testing::StartServer({"--log-level", "warn"});
  ASSERT_NE(server, nullptr);
  const std::vector<std::string> remote = {"--server", server->address()};
  const auto alone = AloneHashes();
  EXPECT_EQ(Hashes(paths_, remote), alone);
  std::vector<std::thread> clients;  // each of them a list of its own
  std::vector<std::map<std::string, std::string>> seen(3);
  for (auto& hashes : seen) clients.emplace_back([&] { hashes = Hashes(paths_, remote); });
  for (std::thread& client : clients) client.join();
  for (const auto& hashes : seen) EXPECT_EQ(hashes, alone);
}
#endif

INSTANTIATE_TEST_SUITE_P(Kinds, AloneInList, ::testing::ValuesIn(Kinds()),
                         [](const auto& test) { return test.param.name; });

// The same kinds as requests of the core.
VoxelizeRequest RequestOf(size_t kind) {
  using testing::FloatTarget;
  VoxelizeRequest request;
  request.grid.resolution = 33;
  switch (kind) {
    case 0: break;
    case 1: request.fill = Fill::kFlood; break;
    case 2: request.targets = {FloatTarget(3, Blend::kAdd, {"normal", {}})}; break;
    case 3: request.result = ResultKind::kSparse; break;
    case 4:
      request.result = ResultKind::kBuckets;
      request.targets = {FloatTarget(2, Blend::kReplace, {"barycentric", {}})};
      break;
    default:
      request.targets = {FloatTarget(1, Blend::kReplace, {"triangle_id", {}}),
                         FloatTarget(3, Blend::kMax, {"position", {}})};
  }
  return request;
}
constexpr size_t kRequests = 6;

TriangleMesh Flat(const ByteVector& glb) {
  const auto scene = LoadScene(glb);
  EXPECT_TRUE(scene.ok()) << scene.status();
  auto mesh = Flatten(*scene);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return *std::move(mesh);
}

testing::Arrays BytesOf(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  return testing::CopyArrays(testing::RunPipeline(mesh, request));
}

// Memory that other runs have used and given back must not show.
TEST(AloneInProcess, AfterOthersAndBesideThem) {
  std::vector<TriangleMesh> meshes;
  for (const ByteVector& glb : Meshes()) meshes.push_back(Flat(glb));
  std::vector<testing::Arrays> alone;
  for (size_t job = 0; job < meshes.size() * kRequests; ++job) {
    alone.push_back(BytesOf(meshes[job / kRequests], RequestOf(job % kRequests)));
    ASSERT_FALSE(alone.back().empty());
  }
  const auto again = [&](size_t job) {
    return BytesOf(meshes[job / kRequests], RequestOf(job % kRequests)) == alone[job];
  };
  for (size_t job = alone.size(); job-- > 0;) EXPECT_TRUE(again(job)) << job;
  std::vector<std::thread> threads;
  for (size_t first = 0; first < 4; ++first) {
    threads.emplace_back([&, first] {
      for (size_t i = 0; i < alone.size(); ++i) EXPECT_TRUE(again((i + 5 * first) % alone.size())) << i;
    });
  }
  for (std::thread& thread : threads) thread.join();
}

// Triangle ids count over the default scene alone.
TEST(AloneInProcess, OneSceneAmongSeveral) {
  const auto add = [](GlbBuilder& builder, const testing::Shape& shape) {
    return builder.Node({{"mesh", builder.Mesh(builder.Primitive(shape.positions, shape.indices))}});
  };
  GlbBuilder single, several;
  single.Scene({add(single, testing::TorusShape(9, 7))});
  const int sphere = add(several, testing::IcosphereShape(1)), torus = add(several, testing::TorusShape(9, 7)),
            cube = add(several, testing::CubeShape());
  several.doc["scenes"] = {{{"nodes", {sphere}}}, {{"nodes", {torus}}}, {{"nodes", {cube, sphere}}}};
  several.doc["scene"] = 1;
  const TriangleMesh alone = Flat(single.Glb()), chosen = Flat(several.Glb());
  for (size_t kind = 0; kind < kRequests; ++kind) {
    EXPECT_EQ(BytesOf(chosen, RequestOf(kind)), BytesOf(alone, RequestOf(kind))) << kind;
  }
}

}  // namespace
}  // namespace voxelpipe
