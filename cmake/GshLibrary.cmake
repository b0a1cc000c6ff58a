# gsh::gsh is what a program links: the core headers with Eigen, GLM and oneTBB.
# gsh::io adds what the file formats need.
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(glm REQUIRED)
find_package(TBB REQUIRED)
find_package(Threads REQUIRED)

file(GLOB_RECURSE gsh_headers CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/include/gsh/*.hpp)

add_library(gsh INTERFACE)
add_library(gsh::gsh ALIAS gsh)
target_sources(gsh INTERFACE FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}/include FILES ${gsh_headers})
target_compile_features(gsh INTERFACE cxx_std_20)
target_link_libraries(gsh INTERFACE glm::glm Eigen3::Eigen TBB::tbb Threads::Threads)
