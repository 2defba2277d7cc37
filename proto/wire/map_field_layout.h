// Compiled in before all else under ThreadSanitizer: there map_field.h gives its class two members more, which the
// Protobuf that a distribution compiled without the sanitizer does not have. The first write to a map field would then
// crash.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#pragma push_macro("__SANITIZE_THREAD__")
#undef __SANITIZE_THREAD__
#include <google/protobuf/map_field.h>
#pragma pop_macro("__SANITIZE_THREAD__")
