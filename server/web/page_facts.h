// What the page must know of this build.
#pragma once

#include <string>

namespace voxelpipe {

// JSON: "methods", those that browsers can call, with the names of their messages; "messages" and "enums", the field
// numbers, types and values of voxelpipe.v1 as its .proto files have them, so that the page encodes and decodes
// messages without a copy of them; "formats", the output formats (format_registry.h); "version".
std::string PageFacts();

}  // namespace voxelpipe
