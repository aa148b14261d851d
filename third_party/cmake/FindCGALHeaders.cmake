# CGAL's 2-D triangulation as plain headers: no GMP or MPFR, nothing to link.
#
# CGAL's own CGALConfig.cmake insists on GMP and MPFR; on integer pixels a double kernel is exact
# without them, so only the headers are asked for.  Defines the target CGAL::Headers.
find_path(CGALHeaders_INCLUDE_DIR CGAL/Delaunay_triangulation_2.h)
find_package(Boost 1.66 QUIET)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(
  CGALHeaders REQUIRED_VARS CGALHeaders_INCLUDE_DIR Boost_INCLUDE_DIRS
  REASON_FAILURE_MESSAGE "install libcgal-dev (Debian, Ubuntu), cgal (Homebrew) or cgal-cpp (conda)")
if(CGALHeaders_FOUND AND NOT TARGET CGAL::Headers)
  add_library(CGAL::Headers INTERFACE IMPORTED)
  target_include_directories(CGAL::Headers SYSTEM INTERFACE ${CGALHeaders_INCLUDE_DIR} ${Boost_INCLUDE_DIRS})
  target_compile_definitions(CGAL::Headers INTERFACE CGAL_DISABLE_GMP CGAL_HEADER_ONLY=1)
endif()
mark_as_advanced(CGALHeaders_INCLUDE_DIR)
