# Runs every line of SOURCE that starts with "//   $ dimple" with the program PROGRAM, in order, in the fresh folder
# FOLDER. The documented commands are thereby tested.
file(REMOVE_RECURSE ${FOLDER})
file(MAKE_DIRECTORY ${FOLDER})
file(STRINGS ${SOURCE} lines REGEX "^//   \\$ dimple ")
list(LENGTH lines count)
if(count EQUAL 0)
  message(FATAL_ERROR "${SOURCE} shows no sample run")
endif()
foreach(line IN LISTS lines)
  string(REGEX REPLACE "^//   \\$ dimple " "" arguments "${line}")
  separate_arguments(words UNIX_COMMAND "${arguments}")
  message(STATUS "dimple ${arguments}")
  execute_process(COMMAND ${PROGRAM} ${words} WORKING_DIRECTORY ${FOLDER} RESULT_VARIABLE code
                  OUTPUT_VARIABLE out ERROR_VARIABLE err)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "dimple ${arguments}\nended with ${code}\n${out}${err}")
  endif()
endforeach()
