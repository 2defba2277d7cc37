// The server's log on stderr: one line an event, as "text" or "json".
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <spdlog/common.h>

namespace voxelpipe {

enum class LogFormat { kText, kJson };

// The level that --log-level and the lines themselves call "debug", "info", "warn", "error" or "off".
spdlog::level::level_enum LevelOf(std::string_view name);

// Makes spdlog's default logger write to stderr from a thread of its own: a stalled reader never delays a call, but
// loses the oldest of some thousand lines. Plain spdlog calls become lines with a message. Call once, before other
// threads log.
void StartLog(spdlog::level::level_enum level, LogFormat format);
// Flushes buffered lines. Logging has no effect afterwards.
void StopLog();

// One field of a line; the key is a string literal.
struct LogField {
  LogField(const char* name, std::string text) : key(name), value(std::move(text)), is_text(true) {}
  LogField(const char* name, uint64_t number) : key(name), value(std::to_string(number)) {}
  LogField(const char* name, double number);  // three digits after the point

  const char* key;
  std::string value;
  bool is_text = false;
};
using LogFields = std::vector<LogField>;

// A line with fields. text: `EVENT key=value key="a text"`; json: {"time": ..., "level": ..., "event": EVENT, "key":
// value, ...}. Keys and the event are ours and need no escape; values are sanitized, cut at 300 bytes and quoted if
// necessary.
class LogLine {
 public:
  // True if a line of this level would be written: for callers with many lines.
  static bool IsWanted(spdlog::level::level_enum level);

  explicit LogLine(std::string_view event);  // in the format of StartLog, text before it
  LogLine(std::string_view event, LogFormat format);
  LogLine& Add(std::string_view key, std::string_view value);
  LogLine& Add(std::string_view key, const char* value) { return Add(key, std::string_view(value)); }
  LogLine& Add(std::string_view key, uint64_t value);
  LogLine& Add(std::string_view key, double value);  // three digits after the point
  LogLine& Add(const LogFields& fields);
  // The line without time and level; in JSON without the braces.
  const std::string& text() const { return text_; }
  void Write(spdlog::level::level_enum level) const;

 private:
  LogLine& Raw(std::string_view key, std::string_view value);

  const bool json_;
  std::string text_;
};

}  // namespace voxelpipe
