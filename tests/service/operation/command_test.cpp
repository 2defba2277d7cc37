// The commands that put work on servers, `bench` and `batch`, with real servers.
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <future>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/json/json.h"
#include "support/resources/closed_port.h"
#include "unit/cli/cli_process.h"
#include "unit/cli/cli_runner.h"

namespace voxelpipe::testing {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

// One triangle with an attribute of its own.
constexpr char kOwnAttributes[] =
    R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
  "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "_TEMPERATURE": 1}}]}],
  "buffers": [{"byteLength": 48, "uri": "data:application/octet-stream;base64,)"
    "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAgQQAAoEEAAPBB\"}],"
    R"(
  "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12}],
  "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
                {"bufferView": 1, "componentType": 5126, "count": 3, "type": "SCALAR"}]})";

class CommandTest : public ::testing::Test {
 protected:
  CommandTest() {
    Write("torus.glb", TorusGlb(12));
    Write("triangles.glb", LargeTrianglesGlb(400));
  }

  void Write(const std::string& name, const std::vector<uint8_t>& bytes) {
    std::ofstream(directory_ / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  }
  std::string Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "error"});
    servers_.push_back(StartServer(arguments));
    return servers_.back() == nullptr ? "" : servers_.back()->address();
  }
  CliOutcome Bench(const std::string& mesh, std::vector<std::string> options, const std::string& prefix = "") {
    options.insert(options.begin(), {"bench", directory_ / mesh, "--json"});
    return RunCli(options, prefix);
  }
  json BenchJson(const std::string& mesh, const std::vector<std::string>& options) {
    const CliOutcome outcome = Bench(mesh, options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.exit_code == 0 ? ParseJson(outcome.out) : json();
  }
  std::string VoxelizeHash(const std::string& mesh, const std::string& resolution) {
    return ParseJson(RunCli({"voxelize", directory_ / mesh, "--resolution", resolution, "--json"}).out)["hash"];
  }

  TemporaryDirectory directory_;
  std::vector<std::unique_ptr<ServerProcess>> servers_;
};

class BenchTest : public CommandTest {};
class SameTextTest : public CommandTest {};

TEST_F(SameTextTest, AnErrorReadsTheSameHereAndServedAndANameOfMegabytesIsCut) {
  const std::string server = Start();
  const std::string name(3 << 20, 'n');
  const std::map<std::string, std::string> files = {
      {"extension", R"({"asset":{"version":"2.0"},"extensionsRequired":[")" + name + R"("]})"},
      {"uri", R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"data:)" + name + R"("}]})"},
      {"version", R"({"asset":{"version":")" + name + R"("}})"},
      {"type",
       R"({"asset":{"version":"2.0"},"accessors":[{"componentType":5126,"count":1,"type":")" + name + R"("}]})"},
      {"nothing", "no mesh at all"},
      {"glb", std::string("glTF\2\0\0\0", 8) + "xxxx"},
      {"empty", ""}};
  for (const auto& [file, text] : files) {
    std::ofstream(directory_ / file, std::ios::binary) << text;
    const CliOutcome here = RunCli({"voxelize", directory_ / file});
    const CliOutcome served = RunCli({"voxelize", directory_ / file, "--server", server});
    EXPECT_EQ(here.exit_code, 1) << file;
    EXPECT_EQ(served.exit_code, 1) << file;
    EXPECT_EQ(here.err, served.err);
    EXPECT_LT(here.err.size(), 1500u);
    EXPECT_EQ(LineCount(here.err), 1u);
  }
}

TEST_F(SameTextTest, SeveralMeshesOnOneGridAreTheSameHereAndServed) {
  const std::string server = Start();
  const json matrix = {0, -1, 0, 2, 1, 0, 0, 0, 0, 0, 1, 0.5, 0, 0, 0, 1};
  const json meshes = {{{"input", "torus.glb"}, {"motion", {{"linear", {1, 2, 3}}}}},
                       {{"input", "triangles.glb"}},
                       {{"input", "torus.glb"}, {"matrix", matrix}, {"name", "turned"}}};
  std::ofstream(directory_ / "list.json") << json{{"meshes", meshes}};
  std::vector<std::string> arguments = {"voxelize", "--together", directory_ / "list.json", "--resolution", "40"};
  arguments.insert(arguments.end(), {"--target", "velocity:f32", "--target", "triangle_id:u32", "--json"});
  const CliOutcome here = RunCli(arguments);
  ASSERT_EQ(here.exit_code, 0) << here.err;
  for (const std::string repeat : {"1", "2"}) {  // at 2 the result comes whole
    std::vector<std::string> served = arguments;
    served.insert(served.end(), {"--server", server, "--repeat", repeat});
    const CliOutcome there = RunCli(served);
    ASSERT_EQ(there.exit_code, 0) << there.err;
    EXPECT_EQ(ParseJson(there.out)["hash"], ParseJson(here.out)["hash"]);
    EXPECT_EQ(ParseJson(there.out)["triangles"], ParseJson(here.out)["triangles"]);
  }
}

TEST_F(BenchTest, AClosedLoopIsAnsweredWithTheRightBytes) {
  const std::string server = Start();
  const json run =
      BenchJson("torus.glb", {"--server", server, "--concurrency", "4", "--duration", "0.5", "--resolution", "16"});
  ASSERT_FALSE(run.is_null());
  EXPECT_GE(run["requests"], 4);
  EXPECT_EQ(run["requests"], run["ok"]);
  EXPECT_TRUE(run["errors"].empty()) << run["errors"];
  EXPECT_EQ(run["hash"], VoxelizeHash("torus.glb", "16"));
  const double seconds = run["seconds"];
  EXPECT_GE(seconds, 0.5);
  EXPECT_NEAR(run["per_second"].get<double>(), run["ok"].get<double>() / seconds, 1e-6);
  EXPECT_NEAR(run["bytes_per_second"].get<double>(),
              run["ok"].get<double>() * run["result_bytes"].get<double>() / seconds, 1e-3);
  const json& latency = run["latency_ms"];
  EXPECT_GT(latency["p50"], 0.0);
  EXPECT_LE(latency["p50"], latency["p90"]);
  EXPECT_LE(latency["p90"], latency["p99"]);
  EXPECT_LE(latency["p99"], latency["max"]);
}

TEST_F(BenchTest, EveryWayToSendGivesTheSameAnswer) {
  const std::string server = Start();
  const std::string hash = VoxelizeHash("torus.glb", "16");
  for (const std::vector<std::string>& way : {std::vector<std::string>{},
                                              {"--send-mesh"},
                                              {"--stream"},
                                              {"--send-mesh", "--stream"},
                                              {"--same-request"},
                                              {"--connections", "3"},
                                              {"--result", "sparse"},
                                              {"--fill", "parity"}}) {
    std::vector<std::string> options = {"--server",   server, "--concurrency", "3",
                                        "--duration", "0.2",  "--resolution",  "16"};
    options.insert(options.end(), way.begin(), way.end());
    const json run = BenchJson("torus.glb", options);
    ASSERT_FALSE(run.is_null()) << ::testing::PrintToString(way);
    EXPECT_EQ(run["requests"], run["ok"]) << run["errors"] << ::testing::PrintToString(way);
    // Whole messages, of which each result is a part.
    EXPECT_GT(run["received_bytes_per_second"], run["bytes_per_second"]) << ::testing::PrintToString(way);
    const bool other_bytes = !way.empty() && (way[0] == "--result" || way[0] == "--fill");
    EXPECT_EQ(run["hash"] == hash, !other_bytes) << ::testing::PrintToString(way);
    EXPECT_EQ(run["mesh"] == "bytes", !way.empty() && way[0] == "--send-mesh") << ::testing::PrintToString(way);
  }
}

TEST_F(BenchTest, TheServersShareIsTold) {
  const std::string server = Start({"--workers", "1"});
  const json run =
      BenchJson("torus.glb", {"--server", server, "--concurrency", "4", "--duration", "0.3", "--resolution", "16"});
  ASSERT_FALSE(run.is_null());
  ASSERT_EQ(run["server"]["workers"].size(), 1u) << run["server"];
  EXPECT_EQ(run["server"]["workers"].begin().key().substr(0, 3), "cpu");
  EXPECT_EQ(*run["server"]["workers"].begin(), run["ok"]);
  EXPECT_GE(run["server"]["batch_jobs"]["mean"], 1.0);
  EXPECT_GT(run["server"]["queue_ms"]["max"], 0.0);
  EXPECT_GT(run["server"]["voxelize_ms"]["max"], 0.0);
}

// The author of a mesh chooses the names in it.
TEST_F(CommandTest, AMeshsErrorsReadTheSameInProcessAndServed) {
  const std::string name(1 << 20, 'n');
  const std::string begin = R"({"asset": {"version": "2.0"}, )";
  const std::map<std::string, std::string> files = {
      {"empty", ""},
      {"nothing", "no mesh at all"},
      {"extension.gltf", begin + R"("extensionsRequired": [")" + name + "\"]}"},
      {"control.gltf", begin + R"("extensionsRequired": ["a\u0007b\nc"]})"},
      {"attribute.gltf", begin + R"("scenes": [{"nodes": [0]}], "scene": 0, "nodes": [{"mesh": 0}],
        "meshes": [{"name": ")" +
                             name + R"(", "primitives": [{"attributes": {"POSITION": 7, "_)" + name + R"(": 8}}]}]})"},
      {"short.glb", std::string("glTF\2\0\0\0\0\1\0\0", 12)}};
  const std::string server = Start();
  for (const auto& [file, text] : files) {
    Write(file, {text.begin(), text.end()});
    const CliOutcome here = RunCli({"voxelize", directory_ / file}),
                     there = RunCli({"voxelize", directory_ / file, "--server", server});
    EXPECT_EQ(here.exit_code, 1) << file;
    EXPECT_EQ(there.exit_code, 1) << file;
    EXPECT_EQ(here.err, there.err) << file;
    EXPECT_LT(here.err.size(), 1500u) << file;
  }
}

TEST_F(CommandTest, AServedRunTellsItsWorkerAndServersTheirDevices) {
  const std::string server = Start({"--backend", "cpu"});
  const CliOutcome voxelize = RunCli({"voxelize", directory_ / "torus.glb", "--server", server, "--json"});
  ASSERT_EQ(voxelize.exit_code, 0) << voxelize.err;
  const json run = ParseJson(voxelize.out);
  EXPECT_THAT(run["worker"].get<std::string>(), HasSubstr("cpu"));
  EXPECT_GE(run["queue_ms"], 0.0);
  EXPECT_EQ(run["batch_jobs"], 1);
  EXPECT_EQ(run["attempts"], 1);
  const json info = ParseJson(RunCli({"server-info", "--server", server, "--json"}).out);
  ASSERT_EQ(info["devices"].size(), 1u);
  EXPECT_EQ(info["devices"][0]["name"], "cpu");
  EXPECT_EQ(info["devices"][0]["state"], "serving");
  EXPECT_GE(info["devices"][0]["workers"], 1);
  EXPECT_THAT(RunCli({"server-info", "--server", server}).out, HasSubstr("device "));
}

TEST_F(CommandTest, CompressedResultsAreTheSameInFewerBytes) {
  const std::string server = Start({"--piece-bytes", "65536"});
  const auto voxelize = [&](const std::string& resolution, const std::vector<std::string>& options) {
    std::vector<std::string> all = {"voxelize", directory_ / "torus.glb",    "--resolution", resolution, "--json",
                                    "--target", "u32:max:shader=triangle_id"};
    all.insert(all.end(), options.begin(), options.end());
    const CliOutcome outcome = RunCli(all);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.exit_code == 0 ? ParseJson(outcome.out) : json();
  };
  for (const std::string resolution : {"16", "100"}) {  // in one message, and in pieces
    const json here = voxelize(resolution, {});
    const json plain = voxelize(resolution, {"--server", server});
    const json compressed = voxelize(resolution, {"--server", server, "--compress", "zstd"});
    ASSERT_FALSE(here.is_null() || plain.is_null() || compressed.is_null());
    EXPECT_FALSE(here.contains("sent_bytes"));
    EXPECT_EQ(plain["hash"], here["hash"]);
    EXPECT_EQ(compressed["hash"], here["hash"]);
    for (const json& run : {plain, compressed}) EXPECT_EQ(run["result_bytes"], here["bytes"]);
    EXPECT_EQ(plain["sent_bytes"], here["bytes"]);
    EXPECT_LT(compressed["sent_bytes"].get<uint64_t>(), here["bytes"].get<uint64_t>() / 4);
  }
  const CliOutcome nowhere = RunCli({"voxelize", directory_ / "torus.glb", "--compress", "zstd"});
  EXPECT_EQ(nowhere.exit_code, 2);
  EXPECT_THAT(nowhere.err, HasSubstr("--server"));
}

// The same report of a mesh from both, but for its health, which only this process checks: a closed surface, an open
// one, and one with attributes and a warning of its own.
TEST_F(CommandTest, AServerSaysOfAMeshWhatThisProcessSays) {
  const std::string server = Start({"--backend", "cpu"});
  const std::string own = kOwnAttributes;
  Write("own.gltf", {own.begin(), own.end()});
  for (const char* mesh : {"torus.glb", "triangles.glb", "own.gltf"}) {
    SCOPED_TRACE(mesh);
    const std::string path = directory_ / mesh;
    const CliOutcome here = RunCli({"info", path}), there = RunCli({"info", path, "--server", server});
    ASSERT_EQ(here.exit_code, 0) << here.err;
    ASSERT_EQ(there.exit_code, 0) << there.err;
    std::string common = here.out;
    const size_t health = common.find("  edges ");
    ASSERT_NE(health, std::string::npos);
    common.erase(health, common.find("  format ") - health);
    EXPECT_EQ(common, there.out);
    json here_json = ParseJson(RunCli({"info", path, "--json"}).out);
    json there_json = ParseJson(RunCli({"info", path, "--server", server, "--json"}).out);
    for (json* facts : {&here_json, &there_json}) {
      EXPECT_GT((*facts)["peak_bytes"], 0);
      EXPECT_GE((*facts)["stages"]["load"], 0.0);
      EXPECT_GE((*facts)["stages"]["flatten"], 0.0);
      facts->erase("peak_bytes");
      facts->erase("stages");
    }
    EXPECT_TRUE(here_json["health"].is_object());
    EXPECT_TRUE(there_json["health"].is_null());
    for (json* facts : {&here_json, &there_json}) facts->erase("health");
    EXPECT_EQ(here_json, there_json);
    EXPECT_EQ(here_json["attributes"].size(), std::string(mesh) == "own.gltf" ? 1u : 0u);
    if (std::string(mesh) == "triangles.glb") {
      EXPECT_GT(there_json["open_edges"], 0) << "counted, not left at 0";
    }
  }
  EXPECT_EQ(RunCli({"shaders", "--server", server}).out, RunCli({"shaders"}).out);
  EXPECT_EQ(RunCli({"shaders", "--server", server, "--json"}).out, RunCli({"shaders", "--json"}).out);
}

TEST_F(CommandTest, EveryLimitOfAServerIsTold) {
  const std::string server = Start({"--backend", "cpu", "--max-mesh-store-bytes", "3MiB"});
  const json limits = ParseJson(RunCli({"server-info", "--server", server, "--json"}).out)["limits"];
  EXPECT_EQ(limits["max_mesh_store_bytes"], 3 << 20);
  EXPECT_GT(limits["max_message_bytes"], 0);
  EXPECT_THAT(RunCli({"server-info", "--server", server}).out, HasSubstr("3.0 MiB"));
}

TEST_F(BenchTest, AnOpenLoopSendsWhatIsDueAndNoMore) {
  const std::string server = Start();
  const json run = BenchJson("torus.glb", {"--server", server, "--rate", "50", "--arrivals", "fixed", "--duration",
                                           "0.6", "--resolution", "16", "--warmup", "0.2"});
  ASSERT_FALSE(run.is_null());
  EXPECT_EQ(run["requests"], 30);
  EXPECT_EQ(run["ok"], 30);
}

TEST_F(BenchTest, LatencyCountsFromWhenARequestWasDue) {
  // Far more than one thread can do: the last response waits at least for the whole drain.
  const std::string server = Start({"--threads", "1", "--workers", "1"});
  const json run =
      BenchJson("triangles.glb", {"--server", server, "--rate", "100", "--duration", "0.3", "--resolution", "64",
                                  "--target", "f32x1:max:shader=barycentric", "--max-in-flight", "2"});
  ASSERT_FALSE(run.is_null());
  EXPECT_GT(run["requests"], 10);
  EXPECT_GE(run["latency_ms"]["max"].get<double>(), run["drain_seconds"].get<double>() * 1000);
  // No more than two at a time: so most of it was spent before they were sent, and none of it is forgotten.
  EXPECT_GE(run["latency_ms"]["max"].get<double>(), run["start_lag_ms"]["max"].get<double>());
}

TEST_F(BenchTest, ErrorsAreCountedByTheirCode) {
  // Each job is predicted to take many times what its deadline leaves. One that fits it alone is refused as
  // RESOURCE_EXHAUSTED where those before it do not leave the time.
  const std::string server = Start({"--threads", "1"});
  const CliOutcome outcome =
      Bench("triangles.glb", {"--server", server, "--concurrency", "4", "--duration", "0.3", "--deadline-ms", "1",
                              "--resolution", "256", "--target", "f32x1:max:shader=barycentric"});
  EXPECT_EQ(outcome.exit_code, 1);  // nothing was answered
  const json run = ParseJson(outcome.out);
  EXPECT_EQ(run["ok"], 0);
  EXPECT_GE(run["errors"]["DEADLINE_EXCEEDED"], 4);
  EXPECT_EQ(run["errors"].size(), 1u) << run["errors"];
  EXPECT_EQ(run["errors"]["DEADLINE_EXCEEDED"], run["requests"]);
}

TEST_F(BenchTest, AWrongRequestFailsBeforeTheLoad) {
  const CliOutcome outcome = Bench("torus.glb", {"--server", Start({"--max-result-bytes", "100"}), "--duration", "5"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("limit"));
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  EXPECT_EQ(outcome.out, "");
}

TEST_F(BenchTest, AServerThatDiesIsCountedAndTheRunEnds) {
  const std::string server = Start();
  std::future<CliOutcome> run = std::async(std::launch::async, [&] {
    return Bench("torus.glb", {"--server", server, "--concurrency", "3", "--duration", std::to_string(3 * kSlowdown),
                               "--resolution", "16"});
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(1200 * kSlowdown));  // the mesh is there, the load has begun
  servers_[0]->Signal(SIGKILL);
  const json json_run = ParseJson(run.get().out);
  EXPECT_GE(json_run["errors"]["UNAVAILABLE"], 1);
  EXPECT_EQ(json_run["requests"], json_run["ok"].get<int>() + json_run["errors"]["UNAVAILABLE"].get<int>())
      << json_run["errors"];
}

TEST_F(BenchTest, AStoppedRunPrintsWhatItHas) {
  const CliOutcome outcome =
      Bench("torus.glb", {"--server", Start(), "--concurrency", "2", "--duration", "60", "--resolution", "16"},
            "timeout --preserve-status --signal=INT " + std::to_string(2 * kSlowdown));
  EXPECT_EQ(outcome.exit_code, 130);
  const json run = ParseJson(outcome.out);
  EXPECT_EQ(run["interrupted"], true);
  EXPECT_LT(run["seconds"], 30.0);
}

class BatchTest : public CommandTest {
 protected:
  void WriteList(int items, int resolution) {
    std::ofstream list(directory_ / "list.jsonl", std::ios::trunc);
    for (int i = 0; i < items; ++i) {
      list << json{{"input", i % 2 == 0 ? "torus.glb" : "triangles.glb"},
                   {"id", "m" + std::to_string(i)},
                   {"resolution", resolution + i},
                   {"target", "f32x3:replace:shader=barycentric"}}
           << '\n';
    }
  }
  std::vector<std::string> Command(const std::string& output, const std::string& servers) {
    std::vector<std::string> arguments = {
        "batch",    directory_ / "list.jsonl",      "--output-dir", directory_ / output, "--json",
        "--report", directory_ / (output + ".json")};
    if (!servers.empty()) arguments.insert(arguments.end(), {"--server", servers, "--jobs", "4"});
    return arguments;
  }
  std::map<std::string, std::vector<uint8_t>> Files(const std::string& output) {
    std::map<std::string, std::vector<uint8_t>> files;
    for (const auto& entry : fs::recursive_directory_iterator(directory_ / output)) {
      if (entry.is_regular_file()) files[entry.path().lexically_relative(directory_ / output)] = ReadFile(entry.path());
    }
    return files;
  }
};

TEST_F(BatchTest, ServersGiveTheFilesThatThisProcessGives) {
  WriteList(8, 16);
  ASSERT_EQ(RunCli(Command("here", "")).exit_code, 0);
  const CliOutcome outcome = RunCli(Command("there", Start() + "," + Start()));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_TRUE(Files("here") == Files("there"));
  std::map<std::string, int> by_server;
  const json report = ParseJson(ReadFile(directory_ / "there.json"));
  for (const json& item : report["items"]) ++by_server[item["server"]];
  EXPECT_EQ(by_server.size(), 2u);
}

TEST_F(BatchTest, AServerThatIsKilledCostsNothingButTime) {
  WriteList(30, 48);
  ASSERT_EQ(RunCli(Command("here", "")).exit_code, 0);
  const std::string servers = Start({"--threads", "1"}) + "," + Start({"--threads", "1"});
  std::future<CliOutcome> run = std::async(std::launch::async, [&] { return RunCli(Command("there", servers)); });
  const auto patience = std::chrono::steady_clock::now() + kPatience;
  while (!fs::exists(directory_ / "there/m2.npy") && std::chrono::steady_clock::now() < patience)
    std::this_thread::yield();
  servers_[0]->Signal(SIGKILL);
  const CliOutcome outcome = run.get();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(ParseJson(outcome.out)["done"], 30);
  EXPECT_TRUE(Files("here") == Files("there"));
}

TEST_F(BatchTest, ABusyServerIsWaitedFor) {
  WriteList(12, 48);
  const std::string server = Start({"--threads", "1", "--workers", "1", "--max-queue", "1"});
  std::vector<std::string> arguments = Command("out", server);
  arguments.insert(arguments.end(), {"--retries", "0"});
  const CliOutcome outcome = RunCli(arguments);
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(ParseJson(outcome.out)["done"], 12);
}

TEST_F(BatchTest, ServersThatAreNotThereEndTheRunAndAreNamed) {
  WriteList(50, 16);
  const ClosedPort closed_port;
  std::vector<std::string> arguments = Command("out", closed_port.address());
  arguments.insert(arguments.end(), {"--lost-timeout", "1"});
  const CliOutcome outcome = RunCli(arguments);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(LineCount(outcome.err), 2u) << outcome.err;  // at once, and at the end
  EXPECT_THAT(outcome.err, HasSubstr(closed_port.address()));
  EXPECT_THAT(outcome.err, HasSubstr("Connection refused"));
  EXPECT_THAT(outcome.err, HasSubstr("50 items are left"));
  const json report = ParseJson(ReadFile(directory_ / "out.json"));
  EXPECT_EQ(report["totals"]["left"], 50);
  EXPECT_THAT(std::string(report["error"]), HasSubstr(closed_port.address()));
}

TEST_F(BatchTest, AServerThatDiesForGoodEndsTheRun) {
  WriteList(30, 48);
  const std::string server = Start({"--threads", "1"});
  std::vector<std::string> arguments = Command("out", server);
  arguments.insert(arguments.end(), {"--lost-timeout", "1"});
  std::future<CliOutcome> run = std::async(std::launch::async, [&] { return RunCli(arguments); });
  const auto patience = std::chrono::steady_clock::now() + kPatience;
  while (!fs::exists(directory_ / "out/m2.npy") && std::chrono::steady_clock::now() < patience)
    std::this_thread::yield();
  servers_[0]->Signal(SIGKILL);
  const CliOutcome outcome = run.get();
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("items are left"));
  EXPECT_GT(ParseJson(outcome.out)["left"], 0);
  EXPECT_EQ(ParseJson(outcome.out)["failed"], 0);
}

TEST_F(BenchTest, TooManyErrorsExitWith1AndRetriesCanBeHonoured) {
  // One worker and hardly a queue: most of what comes at once is refused, with a delay.
  const std::string server = Start({"--threads", "1", "--workers", "1", "--max-queue", "1"});
  for (const std::vector<std::string>& way : {std::vector<std::string>{}, {"--stream"}, {"--many"}}) {
    std::vector<std::string> options = {"--server",   server, "--concurrency", "8",
                                        "--duration", "1",    "--resolution",  "48"};
    options.insert(options.end(), way.begin(), way.end());
    const CliOutcome refused = Bench("triangles.glb", options);
    EXPECT_EQ(refused.exit_code, 1) << refused.out;
    EXPECT_THAT(refused.err, HasSubstr("requests failed: more than --max-error-rate"));
    options.insert(options.end(), {"--max-error-rate", "1"});
    EXPECT_EQ(Bench("triangles.glb", options).exit_code, 0);
    options.push_back("--honour-retry");
    const json honoured = ParseJson(Bench("triangles.glb", options).out);
    const json plain = ParseJson(refused.out);
    EXPECT_GT(honoured["resends"], 0);
    EXPECT_LT(double(honoured["requests"]) - double(honoured["ok"]),
              (double(plain["requests"]) - double(plain["ok"])) / 2);
  }
}

}  // namespace
}  // namespace voxelpipe::testing
