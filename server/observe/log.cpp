#include "observe/log.h"

#include <atomic>
#include <cmath>
#include <memory>

#include <spdlog/async.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

constexpr size_t kLinesInMemory = 8192;
constexpr size_t kValueBytes = 300;
constexpr char kTime[] = "%Y-%m-%dT%H:%M:%S.%e%z";
// The logger of LogLine: its payload is already the inside of a JSON object.
constexpr char kFields[] = "fields";

std::atomic<bool> json_lines{false};
std::atomic<LogLevel> wanted_level{LogLevel::kDebug};

std::string Quoted(std::string_view text) {
  return nlohmann::json(std::string(text)).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// The name for --log-level.
std::string_view LevelName(spdlog::level::level_enum level) {
  switch (level) {
    case spdlog::level::trace:
    case spdlog::level::debug: return "debug";
    case spdlog::level::info: return "info";
    case spdlog::level::warn: return "warn";
    case spdlog::level::err:
    case spdlog::level::critical: return "error";
    default: return "off";
  }
}

spdlog::level::level_enum SpdlogLevel(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug: return spdlog::level::debug;
    case LogLevel::kInfo: return spdlog::level::info;
    case LogLevel::kWarn: return spdlog::level::warn;
    case LogLevel::kError: return spdlog::level::err;
    case LogLevel::kOff: break;
  }
  return spdlog::level::off;
}

// Every line of the log comes by here.
void WriteText(spdlog::logger& logger, LogLevel level, const std::string& text) {
  const std::string clean = CleanText(text);
  logger.log(SpdlogLevel(level), spdlog::string_view_t(clean.data(), clean.size()));
}

class LevelFlag final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& msg, const std::tm&, spdlog::memory_buf_t& out) override {
    const std::string_view name = LevelName(msg.level);
    out.append(name.data(), name.data() + name.size());
  }
  std::unique_ptr<spdlog::custom_flag_formatter> clone() const override { return std::make_unique<LevelFlag>(); }
};

class JsonFormatter final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& msg, spdlog::memory_buf_t& out) override {
    const std::string_view payload(msg.payload.data(), msg.payload.size());
    spdlog::memory_buf_t time;
    time_.format(msg, time);
    std::string line = absl::StrCat("{\"time\":\"", std::string(time.data(), time.size()), "\",\"level\":\"",
                                    std::string(LevelName(msg.level)), "\",");
    if (std::string_view(msg.logger_name.data(), msg.logger_name.size()) == kFields) {
      line += payload;
    } else {
      line += "\"event\":\"message\",\"message\":" + Quoted(payload);
    }
    line += "}\n";
    out.append(line.data(), line.data() + line.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<JsonFormatter>(); }

 private:
  spdlog::pattern_formatter time_{kTime, spdlog::pattern_time_type::local, ""};
};

// True if a value needs no quotes in a text line.
bool IsPlain(std::string_view value) {
  return !value.empty() && value.find_first_of(" =\"\\") == std::string_view::npos;
}

std::string ThreeDigits(double value) {
  return std::isfinite(value) ? absl::StrFormat("%.3f", value) : "0";  // JSON has no other numbers
}

}  // namespace

LogField::LogField(const char* name, double number) : key(name), value(ThreeDigits(number)) {}

LogLevel LevelOf(std::string_view name) {
  for (const LogLevel level : {LogLevel::kDebug, LogLevel::kInfo, LogLevel::kWarn, LogLevel::kError}) {
    if (LevelName(SpdlogLevel(level)) == name) return level;
  }
  return LogLevel::kOff;
}

void StartLog(LogLevel level, LogFormat format) {
  json_lines = format == LogFormat::kJson;
  wanted_level = level;
  spdlog::sink_ptr sink;
  if (json_lines) {
    sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
    sink->set_formatter(std::make_unique<JsonFormatter>());
  } else {
    sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
    auto formatter = std::make_unique<spdlog::pattern_formatter>();
    formatter->add_flag<LevelFlag>('*').set_pattern(absl::StrCat(kTime, " %* %v"));
    sink->set_formatter(std::move(formatter));
  }
  spdlog::init_thread_pool(kLinesInMemory, 1);
  const auto make = [&](const char* name) {
    auto logger = std::make_shared<spdlog::async_logger>(name, sink, spdlog::thread_pool(),
                                                         spdlog::async_overflow_policy::overrun_oldest);
    logger->set_level(SpdlogLevel(level));
    return logger;
  };
  spdlog::set_default_logger(make("voxelpiped"));
  spdlog::register_logger(make(kFields));
}

void StopLog() {
  spdlog::shutdown();
}

void LogMessage(LogLevel level, const std::string& message) {
  if (const auto logger = spdlog::default_logger()) WriteText(*logger, level, message);
}

bool LogLine::IsWanted(LogLevel level) {
  return level >= wanted_level.load(std::memory_order_relaxed);
}

LogLine::LogLine(std::string_view event) : LogLine(event, json_lines ? LogFormat::kJson : LogFormat::kText) {}

LogLine::LogLine(std::string_view event, LogFormat format) : json_(format == LogFormat::kJson) {
  text_ = json_ ? absl::StrCat("\"event\":\"", std::string(event), "\"") : std::string(event);
}

LogLine& LogLine::Raw(std::string_view key, std::string_view value) {
  absl::StrAppend(&text_, json_ ? ",\"" : " ", std::string(key), json_ ? "\":" : "=", std::string(value));
  return *this;
}

LogLine& LogLine::Add(std::string_view key, std::string_view value) {
  const std::string clean = CleanText(value, kValueBytes);
  return Raw(key, json_ || !IsPlain(clean) ? Quoted(clean) : clean);
}

LogLine& LogLine::Add(std::string_view key, uint64_t value) {
  return Raw(key, std::to_string(value));
}

LogLine& LogLine::Add(std::string_view key, double value) {
  return Raw(key, ThreeDigits(value));
}

LogLine& LogLine::Add(const LogFields& fields) {
  for (const LogField& field : fields) {
    if (field.is_text) {
      Add(field.key, field.value);
    } else {
      Raw(field.key, field.value);
    }
  }
  return *this;
}

void LogLine::Write(LogLevel level) const {
  if (const auto logger = spdlog::get(kFields)) {
    WriteText(*logger, level, text_);
  } else {
    LogMessage(level, text_);
  }
}

}  // namespace voxelpipe
