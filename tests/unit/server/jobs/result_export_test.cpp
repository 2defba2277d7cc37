#include "jobs/result_export.h"

#include <memory>
#include <string>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

MakeExport Failing(const std::string& with) {
  return [with](const ParsedConfig&, const JobContext&) -> absl::StatusOr<std::unique_ptr<ResultExport>> {
    return absl::AbortedError(with);
  };
}

std::string TextOf(const MakeExport& make) {
  ParsedConfig config;
  JobContext job;
  return make ? std::string(make(config, job).status().message()) : "none";
}

TEST(ResultExportsTest, AreTakenOnceWithTheirOwnTicket) {
  ResultExports exports;
  const ResultExports::Offer one(exports, Failing("one")), two(exports, Failing("two"));
  EXPECT_NE(one.ticket(), two.ticket());
  EXPECT_EQ(one.ticket().size(), 32u);
  EXPECT_EQ(TextOf(exports.Take(two.ticket())), "two");
  EXPECT_EQ(TextOf(exports.Take(two.ticket())), "none") << "it was taken";
  EXPECT_EQ(TextOf(exports.Take(one.ticket())), "one");
}

TEST(ResultExportsTest, OthersHaveNoTicket) {
  ResultExports exports;
  std::string ticket;
  {
    const ResultExports::Offer offer(exports, Failing("an offer"));
    ticket = offer.ticket();
    EXPECT_EQ(TextOf(exports.Take("")), "none");
    EXPECT_EQ(TextOf(exports.Take(ticket.substr(1))), "none");
    EXPECT_EQ(TextOf(exports.Take(ticket + "0")), "none");
  }
  EXPECT_EQ(TextOf(exports.Take(ticket)), "none") << "the offer has ended";
}

}  // namespace
}  // namespace voxelpipe
