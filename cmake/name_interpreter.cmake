# Lets a package's installed scripts name their interpreter: catkin leaves "env
# python3" there, whatever stands first on PATH.
configure_file(
  ${CMAKE_CURRENT_LIST_DIR}/name_interpreter.cmake.in
  ${CMAKE_CURRENT_BINARY_DIR}/name_interpreter.cmake
  @ONLY
)
install(SCRIPT ${CMAKE_CURRENT_BINARY_DIR}/name_interpreter.cmake)
