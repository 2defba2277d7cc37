# Language, warnings, floating point, sanitizers and ccache, as one interface target that every target of ours links.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
  # With precompiled headers GCC has to keep their names in what it preprocesses, and ccache may not count on dates.
  set(CMAKE_CXX_COMPILER_LAUNCHER
    ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros ${CCACHE_PROGRAM})
  set(CMAKE_CUDA_COMPILER_LAUNCHER ${CCACHE_PROGRAM})
endif()

add_library(voxelpipe_flags INTERFACE)
target_compile_features(voxelpipe_flags INTERFACE cxx_std_20)
# The same bytes on every machine and on both devices: no contraction to fused multiply-add.
target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-ffp-contract=off -Wall -Wextra -Wshadow>)
# Some libraries ask for it, and precompiled headers want the same options everywhere.
target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-pthread>)
# POPCNT and the rounding instructions, which every x86-64 processor since 2009 has; wider ones are chosen at run time.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-march=x86-64-v2>
    $<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=-march=x86-64-v2>)
endif()
# GCC 12 warns in its own header of strings that are assigned, inserted or added (GCC bug 105651).
target_compile_options(voxelpipe_flags INTERFACE $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:
  -Wno-array-bounds -Wno-restrict -Wno-stringop-overflow>)
# The precompiled headers count for its collector of garbage: with its own threshold it searches them again and again.
target_compile_options(voxelpipe_flags INTERFACE
  $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:--param=ggc-min-heapsize=400000>)
if(CCACHE_PROGRAM AND CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-fpch-preprocess>)
endif()
if(VOXELPIPE_WERROR)
  target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-Werror>)
endif()
# The same for device code. Contraction is nvcc's default, so -fmad=false is what keeps both devices equal.
target_compile_options(voxelpipe_flags INTERFACE
  "$<$<COMPILE_LANGUAGE:CUDA>:-fmad=false;-ftz=false;-prec-div=true;-prec-sqrt=true;-Xcompiler=-ffp-contract=off,-Wall,-Wextra>")
if(VOXELPIPE_WERROR)
  target_compile_options(voxelpipe_flags INTERFACE "$<$<COMPILE_LANGUAGE:CUDA>:SHELL:-Werror all-warnings>")
endif()
if(VOXELPIPE_FUZZ)  # so that libFuzzer sees which code a case reaches
  target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-fsanitize=fuzzer-no-link>)
endif()
if(VOXELPIPE_SANITIZE)
  target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-fsanitize=${VOXELPIPE_SANITIZE} -fno-omit-frame-pointer>)
  target_link_options(voxelpipe_flags INTERFACE -fsanitize=${VOXELPIPE_SANITIZE})
  # Instrumented, GCC 12 takes the inside of empty optionals for used.
  target_compile_options(voxelpipe_flags INTERFACE
    $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:-Wno-maybe-uninitialized>)
  if(VOXELPIPE_SANITIZE MATCHES undefined)
    target_compile_options(voxelpipe_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-fno-sanitize-recover=undefined>)
  endif()
endif()
