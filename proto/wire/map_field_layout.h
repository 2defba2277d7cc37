// Included before everything else under ThreadSanitizer, where map_field.h adds two members to its class. A
// distribution's Protobuf, compiled without the sanitizer, does not have them, so the first write to a map field would
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
