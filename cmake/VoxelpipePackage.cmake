# What `cmake --install` puts in place: programs, libraries, headers, and the files by which find_package(voxelpipe) and
# pkg-config find them. Components: `core` (in-process) and `client` (calls a server).
include(CMakePackageConfigHelpers)

# The headers that a program includes; those that they include are installed with them.
set(headers encode/encode.h load/load_mesh.h load/pack.h mesh/health/check_mesh.h pipeline/voxelize.h shaders/catalog.h)
set(programs voxelpipe)
set(libraries voxelpipe_core)
if(TARGET voxelpipe_client)
  list(APPEND headers client.h many_stream.h)
  list(APPEND libraries voxelpipe_client voxelpipe_wire voxelpipe_proto voxelpipe_sha256)
endif()
if(TARGET voxelpiped)
  list(APPEND programs voxelpiped)
endif()

# Before 1.0 a minor version may break sources and binaries, so the name of a shared library has both numbers.
set_target_properties(${libraries} PROPERTIES
  VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
foreach(library ${libraries})
  string(REPLACE voxelpipe_ "" name ${library})
  set_target_properties(${library} PROPERTIES EXPORT_NAME ${name})
  target_include_directories(${library} INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
endforeach()

if(TARGET voxelpipe_shell_files)  # completion and the manual page
  install(DIRECTORY ${PROJECT_BINARY_DIR}/share/ DESTINATION ${CMAKE_INSTALL_DATADIR})
endif()
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/voxelpipe)
install(TARGETS ${programs})
install(TARGETS voxelpipe_core EXPORT voxelpipe-core)
install(EXPORT voxelpipe-core NAMESPACE voxelpipe:: DESTINATION ${package_dir})
if(TARGET voxelpipe_client)
  list(REMOVE_ITEM libraries voxelpipe_core)
  install(TARGETS ${libraries} EXPORT voxelpipe-client)
  install(EXPORT voxelpipe-client NAMESPACE voxelpipe:: DESTINATION ${package_dir})
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/proto/voxelpipe DESTINATION ${CMAKE_INSTALL_DATADIR}/voxelpipe/proto)
endif()
if(TARGET voxelpiped)  # systemd's unit, with the folder that is known at the installation
  install(CODE "
    set(bindir \"\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_BINDIR}\")
    configure_file(${PROJECT_SOURCE_DIR}/docker/systemd/voxelpiped.service.in
      ${PROJECT_BINARY_DIR}/package/voxelpiped.service @ONLY)
    file(INSTALL ${PROJECT_BINARY_DIR}/package/voxelpiped.service
      DESTINATION \"\${CMAKE_INSTALL_PREFIX}/lib/systemd/system\")")
endif()

configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/voxelpipe-config.cmake.in
  ${PROJECT_BINARY_DIR}/package/voxelpipe-config.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/package/voxelpipe-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/package/voxelpipe-config.cmake
  ${PROJECT_BINARY_DIR}/package/voxelpipe-config-version.cmake DESTINATION ${package_dir})

configure_file(${CMAKE_CURRENT_LIST_DIR}/version.h.in ${PROJECT_BINARY_DIR}/package/version.h @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/package/version.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/voxelpipe)
install(CODE "
  set(roots ${PROJECT_SOURCE_DIR}/core ${PROJECT_SOURCE_DIR}/proto ${PROJECT_SOURCE_DIR}/client/cpp)
  set(headers ${headers})
  set(destination ${CMAKE_INSTALL_INCLUDEDIR}/voxelpipe)")
install(SCRIPT ${CMAKE_CURRENT_LIST_DIR}/InstallHeaders.cmake)

# What a static library needs, by pkg-config --static.
set(core_static_packages "absl_flat_hash_map tbb libhwy libpng zlib expat libjpeg libwebp libisal draco")
set(core_static_libraries "-lmeshoptimizer -lpthread")
if(VOXELPIPE_HDF5)
  string(APPEND core_static_packages " hdf5-serial")
endif()
if(VOXELPIPE_OPENVDB)
  string(APPEND core_static_libraries " ${OPENVDB_LIBRARY} ${OPENVDB_IMATH_LIBRARY}")
endif()
if(VOXELPIPE_HAVE_CUDA)
  find_package(CUDAToolkit REQUIRED)
  string(APPEND core_static_libraries " -L${CUDAToolkit_LIBRARY_DIR} -lcudart_static -lrt -ldl")
endif()
file(RELATIVE_PATH pkgconfig_to_prefix /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
foreach(name core client)
  if(TARGET voxelpipe_${name})
    set(made ${PROJECT_BINARY_DIR}/package/voxelpipe-${name}.pc)
    configure_file(${CMAKE_CURRENT_LIST_DIR}/voxelpipe-${name}.pc.in ${made} @ONLY)
    install(FILES ${made} DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
  endif()
endforeach()
