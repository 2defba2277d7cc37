# Precompiled headers: what most files include of the standard library and of third parties is read once. Never a header
# of ours: its change would compile everything again, and a file that forgets to include it must not compile. The test
# `includes` parses the programs without them. Sanitizers and libFuzzer do without: they come with headers of their own.
if(VOXELPIPE_SANITIZE OR VOXELPIPE_FUZZ)
  set(CMAKE_DISABLE_PRECOMPILE_HEADERS ON)
endif()
# One form of code for libraries and programs, so that both can read the same precompiled headers.
set(CMAKE_CXX_COMPILE_OPTIONS_PIE ${CMAKE_CXX_COMPILE_OPTIONS_PIC})

set(VOXELPIPE_STANDARD_HEADERS
  <algorithm> <array> <atomic> <chrono> <cmath> <condition_variable> <cstddef> <cstdint> <cstdio> <cstring> <deque>
  <functional> <limits> <map> <memory> <mutex> <optional> <set> <span> <sstream> <string> <string_view> <thread> <tuple>
  <utility> <variant> <vector>
  <absl/status/status.h> <absl/status/statusor.h> <absl/strings/str_cat.h> <absl/strings/str_format.h>
  <absl/strings/str_join.h> <absl/strings/str_split.h>)

# voxelpipe_precompile(NAME HEADER...): a target NAME whose precompiled headers others read by
# voxelpipe_use_precompiled(TARGET NAME). Both have to be compiled with the same options.
function(voxelpipe_precompile name)
  set(empty ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp)
  file(CONFIGURE OUTPUT ${empty} CONTENT "")
  add_library(${name} OBJECT ${empty})
  target_link_libraries(${name} PRIVATE voxelpipe_flags Threads::Threads)
  target_precompile_headers(${name} PRIVATE ${VOXELPIPE_STANDARD_HEADERS} ${ARGN})
endfunction()

function(voxelpipe_use_precompiled target name)
  target_precompile_headers(${target} REUSE_FROM ${name})
endfunction()
