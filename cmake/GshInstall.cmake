# Installs headers, targets and package files. Each opt-in component has its own export set, so that find_package(gsh)
# needs only the dependencies of the requested components.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

set(gsh_package_dir ${CMAKE_INSTALL_DATADIR}/cmake/gsh) # not in lib/, since nothing depends on the machine

install(TARGETS gsh EXPORT gsh-targets FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(EXPORT gsh-targets NAMESPACE gsh:: DESTINATION ${gsh_package_dir})
foreach(component IN LISTS gsh_components)
  if(TARGET gsh_${component})
    install(TARGETS gsh_${component} EXPORT gsh-${component}-targets
            FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
    install(EXPORT gsh-${component}-targets NAMESPACE gsh:: DESTINATION ${gsh_package_dir})
  endif()
endforeach()

configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/gsh-config.cmake.in ${PROJECT_BINARY_DIR}/gsh-config.cmake
                              INSTALL_DESTINATION ${gsh_package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/gsh-config-version.cmake
                                 COMPATIBILITY SameMinorVersion ARCH_INDEPENDENT)
install(FILES ${PROJECT_BINARY_DIR}/gsh-config.cmake ${PROJECT_BINARY_DIR}/gsh-config-version.cmake
              ${CMAKE_CURRENT_LIST_DIR}/Findlibzip.cmake ${CMAKE_CURRENT_LIST_DIR}/Findstb.cmake
              ${CMAKE_CURRENT_LIST_DIR}/Findtinygltf.cmake ${CMAKE_CURRENT_LIST_DIR}/Findzstd.cmake
              ${CMAKE_CURRENT_LIST_DIR}/GshPrecompile.cmake
        DESTINATION ${gsh_package_dir})

# For builds without CMake: gsh.pc, gsh-io.pc and so on, which find the headers from where they are themselves. Libraries
# without a .pc file of their own everywhere are named by -l. gsh::cuda has none, since nvcc needs no flag for it.
set(gsh_pc_dir ${CMAKE_INSTALL_DATADIR}/pkgconfig)
cmake_path(RELATIVE_PATH CMAKE_INSTALL_FULL_INCLUDEDIR BASE_DIRECTORY ${CMAKE_INSTALL_PREFIX}/${gsh_pc_dir}
           OUTPUT_VARIABLE gsh_pc_includes)
function(gsh_add_pc name description requires libs)
  if(libs)
    set(libs "\nLibs: ${libs}") # vcpkg refuses an empty line of this name
  endif()
  configure_file(${CMAKE_CURRENT_FUNCTION_LIST_DIR}/gsh.pc.in ${PROJECT_BINARY_DIR}/${name}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/${name}.pc DESTINATION ${gsh_pc_dir})
endfunction()
gsh_add_pc(gsh "Animatable 3D Gaussian humans, header-only" "eigen3 >= 3.4, glm, tbb" "")
if(TARGET gsh_io)
  set(stb)
  if(stb_LIBRARY)
    set(stb -lstb)
  endif()
  gsh_add_pc(gsh-io "Readers and writers of gsh" "gsh = ${PROJECT_VERSION}, libzip, zlib, libzstd, nlohmann_json"
             "-ltinygltf ${stb}")
  gsh_add_pc(gsh-check "Tests of captures for gsh" "gsh-io = ${PROJECT_VERSION}" "")
  gsh_add_pc(gsh-reconstruct "Reconstruction from captures, of gsh" "gsh-io = ${PROJECT_VERSION}" "")
endif()
if(TARGET gsh_synthetic)
  gsh_add_pc(gsh-synthetic "The built-in actor and the studio of gsh" "gsh-io = ${PROJECT_VERSION}" "-lembree3")
endif()
