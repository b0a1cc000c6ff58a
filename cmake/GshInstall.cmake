# Installs headers, targets and package files. Each opt-in component has its own export set, so that find_package(gsh)
# needs only the dependencies of the requested components.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

set(gsh_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/gsh)

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
