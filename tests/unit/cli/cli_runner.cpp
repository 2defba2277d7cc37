#include "unit/cli/cli_runner.h"

#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <utility>

namespace voxelpipe::testing {

std::string ShellQuoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

CliOutcome RunCli(const std::vector<std::string>& arguments, const std::string& prefix,
                  const std::string& redirections) {
  const TemporaryDirectory directory;
  std::string command = prefix + " " + ShellQuoted(VOXELPIPE_CLI);
  for (const std::string& argument : arguments) command += " " + ShellQuoted(argument);
  command +=
      " >" + ShellQuoted(directory / "out") + " 2>" + ShellQuoted(directory / "err") + " </dev/null " + redirections;
  const int status = std::system(command.c_str());
  CliOutcome outcome;
  outcome.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  for (const auto& [name, text] : {std::pair{"out", &outcome.out}, std::pair{"err", &outcome.err}}) {
    const std::vector<uint8_t> bytes = ReadFile(directory / name);
    text->assign(bytes.begin(), bytes.end());
  }
  return outcome;
}

size_t LineCount(const std::string& text) {
  return size_t(std::count(text.begin(), text.end(), '\n'));
}

void WriteBoxGlb(const std::string& path, float x, float y, float z) {
  std::vector<float> positions;
  for (int corner = 0; corner < 8; ++corner) {
    positions.insert(positions.end(), {corner & 1 ? x : 0, corner & 2 ? y : 0, corner & 4 ? z : 0});
  }
  const std::vector<uint16_t> indices = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                         2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
  std::string binary(reinterpret_cast<const char*>(positions.data()), positions.size() * 4);
  binary.append(reinterpret_cast<const char*>(indices.data()), indices.size() * 2);
  const nlohmann::json document = {
      {"asset", {{"version", "2.0"}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"mesh", 0}}}},
      {"meshes", {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}}}}}}},
      {"buffers", {{{"byteLength", binary.size()}}}},
      {"bufferViews",
       {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", 96}},
        {{"buffer", 0}, {"byteOffset", 96}, {"byteLength", 72}}}},
      {"accessors",
       {{{"bufferView", 0},
         {"componentType", 5126},
         {"count", 8},
         {"type", "VEC3"},
         {"min", {0, 0, 0}},
         {"max", {x, y, z}}},
        {{"bufferView", 1}, {"componentType", 5123}, {"count", 36}, {"type", "SCALAR"}}}}};
  std::string json = document.dump();
  json.append((4 - json.size() % 4) % 4, ' ');
  const auto word = [](size_t value) {
    const uint32_t number = uint32_t(value);
    return std::string(reinterpret_cast<const char*>(&number), 4);
  };
  std::ofstream(path, std::ios::binary) << "glTF" << word(2) << word(28 + json.size() + binary.size())
                                        << word(json.size()) << "JSON" << json << word(binary.size())
                                        << std::string("BIN\0", 4) << binary;
}

}  // namespace voxelpipe::testing
