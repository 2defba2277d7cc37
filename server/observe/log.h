// The server's log on stderr: one line an event, as "text" or "json".
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace voxelpipe {

enum class LogFormat : uint8_t { kText, kJson };
enum class LogLevel : uint8_t { kDebug, kInfo, kWarn, kError, kOff };

// The level that --log-level and the lines themselves call "debug", "info", "warn", "error" or "off".
LogLevel LevelOf(std::string_view name);

// Makes the log write to stderr from a thread of its own: a stalled reader never delays a call, but loses the oldest of
// some thousand lines. Call once, before other threads log. (spdlog does it; its headers stay in log.cpp, because they
// take seconds to compile.)
void StartLog(LogLevel level, LogFormat format);
// Flushes buffered lines. Logging has no effect afterwards.
void StopLog();

// Writes a line with a text and nothing else.
void LogMessage(LogLevel level, const std::string& message);

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
  static bool IsWanted(LogLevel level);

  explicit LogLine(std::string_view event);  // in the format of StartLog, text before it
  LogLine(std::string_view event, LogFormat format);
  LogLine& Add(std::string_view key, std::string_view value);
  LogLine& Add(std::string_view key, const char* value) { return Add(key, std::string_view(value)); }
  LogLine& Add(std::string_view key, uint64_t value);
  LogLine& Add(std::string_view key, double value);  // three digits after the point
  LogLine& Add(const LogFields& fields);
  // The line without time and level; in JSON without the braces.
  const std::string& text() const { return text_; }
  void Write(LogLevel level) const;

 private:
  LogLine& Raw(std::string_view key, std::string_view value);

  const bool json_;
  std::string text_;
};

}  // namespace voxelpipe
