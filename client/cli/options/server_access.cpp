#include "options/server_access.h"

#include <cstdlib>
#include <optional>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "command_line/command.h"
#include "load/local_file.h"
#ifdef VOXELPIPE_HAVE_SERVICE
#include "client.h"
#endif

namespace voxelpipe::cli {
namespace {

struct Flags {
  bool tls = false;
  std::string ca, cert, key, server_name, token_file, compress;
};

// A process runs one command, so one set serves the flags of all commands.
Flags& TheFlags() {
  static Flags flags;
  return flags;
}

}  // namespace

void AddServerAccessFlags(Command& app) {
  Flags& flags = TheFlags();
  for (Command command : app.commands()) {
    const std::optional<Option> server = command.FindOption("--server");
    if (!server) continue;
    const auto add = [&](const char* name, std::string& value, const char* type, const char* help) {
      command.AddOption(name, value, help).Type(type).Group("The server").Needs(*server);
    };
    command.AddFlag("--tls", flags.tls, "Use TLS, with the system's CA certificates")
        .Group("The server")
        .Needs(*server);
    add("--tls-ca", flags.ca, "FILE", "Use TLS, with these CA certificates (PEM)");
    add("--tls-cert", flags.cert, "FILE", "Use TLS, with this client certificate (PEM); needs --tls-key");
    add("--tls-key", flags.key, "FILE", "The key of --tls-cert (PEM)");
    add("--tls-server-name", flags.server_name, "NAME", "Use TLS; the name in the server's certificate");
    add("--token-file", flags.token_file, "FILE",
        "Send the token in this file (otherwise that of VOXELPIPE_TOKEN, if set)");
    // For commands that receive results; bench has an option of its own.
    if (command.name() != "voxelize" && command.name() != "batch") continue;
    command.AddOption("--compress", flags.compress, "Compression of results for the transfer (default none)")
        .Type("none|zstd")
        .Group("The server")
        .Choices({"none", "zstd"})
        .Needs(*server);
    command.FindOption("--threads")->Excludes(*server);  // the server's own option decides
  }
}

#ifdef VOXELPIPE_HAVE_SERVICE
absl::StatusOr<ConnectOptions> MakeConnectOptions() {
  const Flags& flags = TheFlags();
  ConnectOptions options;
  if (flags.compress == "zstd") options.settings.compression = Compression::kZstd;
  if (flags.tls || !(flags.ca + flags.cert + flags.key + flags.server_name).empty()) {
    options.tls = ClientTls{flags.ca, flags.cert, flags.key, flags.server_name};
  }
  if (!flags.token_file.empty()) {
    constexpr uint64_t kMaxTokenFileBytes = 1 << 20;
    const absl::StatusOr<FileBytes> bytes = ReadLocalFile(flags.token_file, kMaxTokenFileBytes);
    if (!bytes.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat("--token-file: ", flags.token_file, ": ", std::string(bytes.status().message())));
    }
    std::istringstream text(std::string(bytes->begin(), bytes->end()));
    if (!(text >> options.token)) {
      return absl::InvalidArgumentError(absl::StrCat("--token-file: ", flags.token_file, " holds no token"));
    }
  } else if (const char* token = std::getenv("VOXELPIPE_TOKEN")) {
    options.token = token;
  }
  return options;
}
#endif

}  // namespace voxelpipe::cli
