# Finds tinygltf by its header and library. Only Debian's package has a config file, under another name.
find_path(tinygltf_INCLUDE_DIR tiny_gltf.h)
find_library(tinygltf_LIBRARY tinygltf)
mark_as_advanced(tinygltf_INCLUDE_DIR tinygltf_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(tinygltf REQUIRED_VARS tinygltf_LIBRARY tinygltf_INCLUDE_DIR)

if(tinygltf_FOUND AND NOT TARGET tinygltf::tinygltf)
  add_library(tinygltf::tinygltf UNKNOWN IMPORTED)
  set_target_properties(tinygltf::tinygltf PROPERTIES IMPORTED_LOCATION ${tinygltf_LIBRARY}
                                                      INTERFACE_INCLUDE_DIRECTORIES ${tinygltf_INCLUDE_DIR})
endif()
