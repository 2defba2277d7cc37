// Messages that name the next step.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "cli_runner.h"
#include "support/resources/closed_port.h"

namespace voxelpipe {
namespace {

using testing::CliOutcome;
using testing::ClosedPort;
using ::testing::HasSubstr;
using testing::LineCount;
using ::testing::Not;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliMessages : public ::testing::Test {
 protected:
  CliMessages() : box_(directory_ / "box.glb") { WriteBoxGlb(box_, 1, 1, 1); }

  // What stderr says, on one line.
  static std::string Error(const std::vector<std::string>& arguments, int exit_code) {
    const CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, exit_code) << outcome.err;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    return outcome.err;
  }

  TemporaryDirectory directory_;
  std::string box_;
};

TEST_F(CliMessages, AMistypedOptionNamesTheNearestAndTheHelpOfItsCommand) {
  EXPECT_THAT(Error({"voxelize", box_, "--resolutoin", "4"}, 2),
              HasSubstr("(did you mean '--resolution'?); see 'voxelpipe voxelize --help'"));
  EXPECT_THAT(Error({"voxelize", box_, "--filll=parity"}, 2), HasSubstr("did you mean '--fill'?"));
  EXPECT_THAT(Error({"voxelize", box_, "--fil=parity"}, 2), HasSubstr("did you mean '--fill'?"));
  EXPECT_THAT(Error({"info", box_, "--jsn"}, 2), HasSubstr("did you mean '--json'?); see 'voxelpipe info --help'"));
  EXPECT_THAT(Error({"voxelize", box_, "--wholly-unknown"}, 2), Not(HasSubstr("did you mean")));
}

TEST_F(CliMessages, AValueThatIsNoNumberOrIsMissingIsNamed) {
  EXPECT_THAT(Error({"voxelize", box_, "--resolution", "abc"}, 2),
              HasSubstr("--resolution: 'abc' is no number that it takes; see 'voxelpipe voxelize --help'"));
  EXPECT_THAT(Error({"voxelize", box_, "--repeat", "99999999999999999999"}, 2),
              HasSubstr("--repeat: '99999999999999999999' is no number that it takes"));
  EXPECT_THAT(Error({"voxelize", box_, "--resolution"}, 2), HasSubstr("--resolution needs a value, N; see"));
  EXPECT_THAT(Error({"voxelize", box_, "--backend", "gpu"}, 2), HasSubstr("did you mean 'cuda'?"));
  EXPECT_THAT(Error({"shaders", "extra"}, 2), HasSubstr("one argument too many: 'extra'; see 'voxelpipe shaders"));
}

#ifdef VOXELPIPE_HAVE_SERVICE
TEST_F(CliMessages, AnOptionOfTheOtherPlaceIsRefused) {
  for (const char* flag : {"--token-file", "--tls-ca", "--tls-cert", "--tls-key", "--tls-server-name"}) {
    EXPECT_THAT(Error({"voxelize", box_, flag, "x"}, 2), HasSubstr(std::string(flag) + " requires --server")) << flag;
  }
  EXPECT_THAT(Error({"voxelize", box_, "--tls"}, 2), HasSubstr("--tls requires --server"));
  const ClosedPort closed_port;
  EXPECT_THAT(Error({"voxelize", box_, "--threads", "2", "--server", closed_port.address()}, 2),
              HasSubstr("--threads excludes --server"));
}
#endif

TEST_F(CliMessages, AMistypedCommandNamesTheNearest) {
  EXPECT_THAT(Error({"voxelise", box_}, 2),
              HasSubstr("there is no command 'voxelise' (did you mean 'voxelize'?); see 'voxelpipe --help'"));
  EXPECT_THAT(Error({}, 2), HasSubstr("see 'voxelpipe --help'"));
}

TEST_F(CliMessages, AMistypedShaderParameterOrChoiceNamesTheNearest) {
  EXPECT_THAT(Error({"voxelize", box_, "--shader", "normals"}, 2), HasSubstr("did you mean 'normal'? known: "));
  EXPECT_THAT(Error({"voxelize", box_, "--vertex-shader", "transfrom"}, 2), HasSubstr("did you mean 'transform'?"));
  EXPECT_THAT(Error({"voxelize", box_, "--shader", "constant:valeu=1"}, 2), HasSubstr("did you mean 'value'?"));
  EXPECT_THAT(Error({"voxelize", box_, "--shader", "normal:scale=1"}, 2), HasSubstr("it takes none"));
  EXPECT_THAT(Error({"voxelize", box_, "--fill", "partiy"}, 2), HasSubstr("did you mean 'parity'? known are none"));
}

TEST_F(CliMessages, AMissingMeshNamesTheNearestFileOrTheMissingDirectory) {
  for (const char* command : {"voxelize", "info"}) {
    EXPECT_THAT(Error({command, directory_ / "bxo.glb"}, 1), HasSubstr("no such file (did you mean '" + box_ + "'?)"));
    EXPECT_THAT(Error({command, directory_ / "no/box.glb"}, 1),
                HasSubstr("there is no directory '" + directory_ / "no" + "'"));
  }
  const std::string far = Error({"voxelize", directory_ / "wholly-different.obj"}, 1);
  EXPECT_THAT(far, HasSubstr("no such file"));
  EXPECT_THAT(far, Not(HasSubstr("did you mean")));
}

#ifdef VOXELPIPE_HAVE_SERVICE
TEST_F(CliMessages, AServerThatIsNotThereNamesHowToStartOne) {
  const ClosedPort closed_port;
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"voxelize", box_}, {"info", box_}, {"shaders"}, {"server-info"}}) {
    std::vector<std::string> with_server = arguments;
    with_server.insert(with_server.end(), {"--server", closed_port.address()});
    EXPECT_THAT(Error(with_server, 1),
                HasSubstr("'voxelpiped --listen " + closed_port.address() + "' starts a server there"));
  }
}
#endif

}  // namespace
}  // namespace voxelpipe
