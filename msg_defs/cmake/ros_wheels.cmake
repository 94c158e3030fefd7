# Read right after project(bow_msgs), and only where the ROS that is built against comes from PyPI's ros-jazzy-* wheels:
# by msg_defs/pyproject.toml, or with --cmake-args -DCMAKE_PROJECT_bow_msgs_INCLUDE=cmake/ros_wheels.cmake.
# A ROS installation needs none of this.

# (a) The wheels put ROS into the Python environment itself: <prefix>/lib/pythonX.Y/site-packages, <prefix>/share, ...
#     So the prefix lies four parents above any package of theirs.
find_package(Python3 REQUIRED COMPONENTS Interpreter)
execute_process(
  COMMAND "${Python3_EXECUTABLE}" -c
          "import pathlib, rosidl_pycommon as m; print(pathlib.Path(m.__file__).resolve().parents[4].as_posix())"
  OUTPUT_VARIABLE ros_wheels_prefix
  OUTPUT_STRIP_TRAILING_WHITESPACE
  RESULT_VARIABLE ros_wheels_missing)
if(ros_wheels_missing)
  message(FATAL_ERROR "The ROS wheels are not installed for ${Python3_EXECUTABLE}: it cannot import rosidl_pycommon. "
                      "They are listed under [build-system] in msg_defs/pyproject.toml; on a ROS installation, leave "
                      "out -DCMAKE_PROJECT_bow_msgs_INCLUDE.")
endif()
list(PREPEND CMAKE_PREFIX_PATH "${ros_wheels_prefix}")
if(DEFINED ENV{AMENT_PREFIX_PATH})
  set(ENV{AMENT_PREFIX_PATH} "${ros_wheels_prefix}:$ENV{AMENT_PREFIX_PATH}")
else()
  set(ENV{AMENT_PREFIX_PATH} "${ros_wheels_prefix}")
endif()

# (b) The libraries land in <prefix>/lib and the Python extensions in <prefix>/lib/pythonX.Y/site-packages/bow_msgs:
#     each finds its neighbours without LD_LIBRARY_PATH.
set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/../../..")

# (c) The wheels' exported targets name include folders of the machine that built them, and CMake stops on a folder that
#     is not there. Drop those, at the end of this directory, when every package has been found.
function(ros_wheels_drop_missing_includes)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(folders)
      set(present "")
      foreach(folder IN LISTS folders)
        if(folder MATCHES "\\$<" OR EXISTS "${folder}")
          list(APPEND present "${folder}")
        endif()
      endforeach()
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${present}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL ros_wheels_drop_missing_includes)
