#include "commands/progress_view.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>

#include "base/text.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {
namespace {

double Ms(std::chrono::steady_clock::duration time) {
  return std::chrono::duration<double, std::milli>(time).count();
}

size_t TerminalColumns() {
  constexpr size_t kUsual = 80;
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col : kUsual;
}

}  // namespace

void AddProgressFlag(Command& command, std::string& kind, const std::string& group) {
  command
      .AddOption("--progress", kind,
                 Wrapped("Progress on standard error: auto (default) a line if that is a terminal, json an object a "
                         "line (stage, fraction, item, items, elapsed_ms, eta_ms), none"))
      .Type("auto|json|none")
      .Group(group)
      .Choices({"auto", "json", "none"});
}

ProgressView::ProgressView(const std::string& kind, size_t items)
    : kind_(kind == "json"                                 ? Kind::kJson
            : kind == "none" || isatty(STDERR_FILENO) != 1 ? Kind::kNone
                                                           : Kind::kLine) {
  state_.items = items;
}

ProgressView::~ProgressView() {
  Clear();
}

void ProgressView::Begin(size_t item) {
  state_.item = item;
  state_.stage.clear();
  state_.fraction = 0;
  voxels_ = 0;
  item_begin_ = Clock::now();
}

void ProgressView::Show(std::string_view stage, double fraction) {
  const bool next = state_.stage != stage;
  state_.stage = std::string(stage);
  state_.fraction = fraction;
  Draw(next);
}

void ProgressView::ShowEnded(size_t ended, size_t failed) {
  const bool changed = ended != state_.ended || failed != state_.failed;
  state_.item = state_.ended = ended;
  state_.failed = failed;
  state_.stage = kind_ == Kind::kJson ? "items" : "";  // the line counts them anyway
  state_.fraction = state_.items == 0 ? 0 : double(ended) / double(state_.items);
  if (changed || kind_ == Kind::kLine) Draw(false);
}

void ProgressView::End(bool failed) {
  ++state_.ended;
  state_.failed += failed ? 1 : 0;
}

void ProgressView::Finish() {
  Clear();
  state_.stage = "done";
  state_.fraction = 1;
  if (kind_ == Kind::kJson) Draw(true);
}

void ProgressView::Draw(bool at_once) {
  using std::chrono::milliseconds;
  if (kind_ == Kind::kNone) return;
  const Clock::time_point now = Clock::now();
  state_.elapsed_ms = Ms(now - begin_);
  if (kind_ == Kind::kJson) {
    if (!at_once && now - last_ < milliseconds(100)) return;
    last_ = now;
    WriteLine(stderr, ProgressJson(state_));
    return;
  }
  // Not for jobs that end at once, and at most as often as the eye can follow.
  if (now - last_ < milliseconds(80)) return;
  last_ = now;
  state_.voxels_per_second.reset();
  if (voxels_ > 0 && state_.fraction > 0) {
    state_.voxels_per_second = double(voxels_) * state_.fraction * 1000 / Ms(now - item_begin_);
  }
  const std::string line = CleanText(ProgressLine(state_, TerminalColumns() - 1));  // a stage may be a server's text
  std::fprintf(stderr, "\r%s\033[K", line.c_str());
  std::fflush(stderr);
  drawn_ = true;
}

void ProgressView::Clear() {
  if (drawn_) std::fputs("\r\033[K", stderr);
  drawn_ = false;
}

}  // namespace voxelpipe::cli
