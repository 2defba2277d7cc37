# Decides VOXELPIPE_HAVE_VIEWER: the program of .html results is bundled with npm's esbuild, when the build is
# configured. Without npm, or without its packages, everything else is built.
set(VOXELPIPE_HAVE_VIEWER OFF)
set(viewer_dir ${PROJECT_BINARY_DIR}/viewer)
set(VOXELPIPE_VIEWER_PAGE ${viewer_dir}/page-with-style.html)
set(VOXELPIPE_VIEWER_SCRIPT ${viewer_dir}/program.js)

# Sets `reason`, empty if the program was made.
function(voxelpipe_bundle_viewer reason)
  find_program(VOXELPIPE_NPM npm)
  find_program(VOXELPIPE_NODE node)
  if(NOT VOXELPIPE_NPM OR NOT VOXELPIPE_NODE)
    set(${reason} "npm is not installed (make setup)" PARENT_SCOPE)
    return()
  endif()
  file(GLOB files CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/core/encode/viewer/*.js
    ${PROJECT_SOURCE_DIR}/core/encode/viewer/*.json ${PROJECT_SOURCE_DIR}/core/encode/viewer/*.html
    ${PROJECT_SOURCE_DIR}/core/encode/viewer/*.css)
  set_property(DIRECTORY ${PROJECT_SOURCE_DIR} APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${files})
  file(COPY ${files} DESTINATION ${viewer_dir})
  set(stamp ${viewer_dir}/node_modules/.package-lock.json)
  if(NOT EXISTS ${stamp} OR ${viewer_dir}/package-lock.json IS_NEWER_THAN ${stamp})
    execute_process(COMMAND ${VOXELPIPE_NPM} ci --no-audit --no-fund --silent WORKING_DIRECTORY ${viewer_dir}
      TIMEOUT 120 RESULT_VARIABLE failed OUTPUT_QUIET ERROR_QUIET)
    if(failed)
      set(${reason} "npm cannot install three and esbuild" PARENT_SCOPE)
      return()
    endif()
  endif()
  execute_process(
    COMMAND node_modules/.bin/esbuild main.js --bundle --minify --format=esm --log-level=warning
      --outfile=${VOXELPIPE_VIEWER_SCRIPT}
    WORKING_DIRECTORY ${viewer_dir} TIMEOUT 60 RESULT_VARIABLE failed ERROR_VARIABLE output)
  if(failed)
    set(${reason} "esbuild failed: ${output}" PARENT_SCOPE)
    return()
  endif()
  file(READ ${VOXELPIPE_VIEWER_SCRIPT} script)
  if(script MATCHES "</script")
    set(${reason} "the script would end its own element" PARENT_SCOPE)
    return()
  endif()
  file(READ ${viewer_dir}/page.html page)
  file(READ ${viewer_dir}/viewer.css style)
  string(REPLACE "@CSS@" "${style}" page "${page}")
  file(CONFIGURE OUTPUT ${VOXELPIPE_VIEWER_PAGE} CONTENT "${page}" @ONLY)
  set(${reason} "" PARENT_SCOPE)
endfunction()

if(NOT VOXELPIPE_VIEWER STREQUAL "OFF")
  voxelpipe_bundle_viewer(viewer_missing)
  if(viewer_missing STREQUAL "")
    set(VOXELPIPE_HAVE_VIEWER ON)
  elseif(VOXELPIPE_VIEWER STREQUAL "ON")
    message(FATAL_ERROR "VOXELPIPE_VIEWER=ON, but ${viewer_missing}")
  else()
    message(STATUS "VoxelPipe: no .html results, as ${viewer_missing}")
  endif()
endif()
