#include "web/page_files.h"

#include <algorithm>
#include <string>

#include "web/page_facts.h"

// Of cmake/VoxelpipeEmbed.cmake.
extern "C" {
extern const char page_index_html_begin[], page_index_html_end[];
extern const char page_page_css_begin[], page_page_css_end[];
extern const char page_page_js_begin[], page_page_js_end[];
extern const char page_client_js_begin[], page_client_js_end[];
extern const char page_mesh_js_begin[], page_mesh_js_end[];
extern const char page_messages_js_begin[], page_messages_js_end[];
extern const char page_example_js_begin[], page_example_js_end[];
extern const char page_options_js_begin[], page_options_js_end[];
extern const char page_rules_js_begin[], page_rules_js_end[];
extern const char page_viewer_css_begin[], page_viewer_css_end[];
extern const char page_viewer_js_begin[], page_viewer_js_end[];
}

namespace voxelpipe {
namespace {

constexpr char kHtml[] = "text/html; charset=utf-8", kCss[] = "text/css; charset=utf-8";
constexpr char kScript[] = "text/javascript; charset=utf-8", kJson[] = "application/json";

std::string_view Between(const char* begin, const char* end) {
  return {begin, size_t(end - begin)};
}

}  // namespace

const PageFile* FindPageFile(std::string_view path) {
  static const std::string facts = PageFacts();
  static const PageFile files[] = {
      {"/", kHtml, Between(page_index_html_begin, page_index_html_end)},
      {"/page.css", kCss, Between(page_page_css_begin, page_page_css_end)},
      {"/page.js", kScript, Between(page_page_js_begin, page_page_js_end)},
      {"/client.js", kScript, Between(page_client_js_begin, page_client_js_end)},
      {"/mesh.js", kScript, Between(page_mesh_js_begin, page_mesh_js_end)},
      {"/messages.js", kScript, Between(page_messages_js_begin, page_messages_js_end)},
      {"/example.js", kScript, Between(page_example_js_begin, page_example_js_end)},
      {"/options.js", kScript, Between(page_options_js_begin, page_options_js_end)},
      {"/rules.js", kScript, Between(page_rules_js_begin, page_rules_js_end)},
      {"/viewer.css", kCss, Between(page_viewer_css_begin, page_viewer_css_end)},
      {"/viewer.js", kScript, Between(page_viewer_js_begin, page_viewer_js_end)},
      {"/facts.json", kJson, facts},
  };
  const auto* const found =
      std::find_if(std::begin(files), std::end(files), [&](const auto& f) { return f.path == path; });
  return found == std::end(files) ? nullptr : found;
}

}  // namespace voxelpipe
