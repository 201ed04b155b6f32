# Installs the build tree into a folder of its own, then builds apps/examples/indent.cpp against the installed package as
# a project of its own would, once with the static libraries and once with the shared one, and runs both: they must say
# the same. Run as
#   cmake -D BUILD=<build> -D SOURCE=<root> -D FOLDER=<scratch> -D COMPILER=<c++> -P package.cmake
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_VARIABLE said ERROR_VARIABLE said)
  if(NOT code EQUAL 0)
    list(JOIN ARGN " " command)
    message(FATAL_ERROR "${command}\nended with ${code}:\n${said}")
  endif()
  set(said "${said}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${FOLDER})
file(MAKE_DIRECTORY ${FOLDER}/project)
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${FOLDER}/prefix)
file(COPY ${SOURCE}/apps/examples/indent.cpp DESTINATION ${FOLDER}/project)
file(WRITE ${FOLDER}/project/CMakeLists.txt "cmake_minimum_required(VERSION 3.25)
project(Outside CXX)
find_package(Dimple REQUIRED)
add_executable(with_static indent.cpp)
target_link_libraries(with_static PRIVATE Dimple::preprocess Dimple::solver)
add_executable(with_shared indent.cpp)
target_link_libraries(with_shared PRIVATE Dimple::shared)
")
file(WRITE ${FOLDER}/solver_alone/CMakeLists.txt "cmake_minimum_required(VERSION 3.25)
project(SolverAlone CXX)
find_package(Dimple REQUIRED COMPONENTS solver)
if(NOT TARGET Dimple::solver OR TARGET Dimple::io OR ITK_FOUND OR VTK_FOUND)
  message(FATAL_ERROR \"the solver alone was asked for\")
endif()
")
run(${CMAKE_COMMAND} -S ${FOLDER}/solver_alone -B ${FOLDER}/solver_alone/build
    -D CMAKE_PREFIX_PATH=${FOLDER}/prefix -D CMAKE_CXX_COMPILER=${COMPILER})
run(${CMAKE_COMMAND} -S ${FOLDER}/project -B ${FOLDER}/build -D CMAKE_BUILD_TYPE=Release
    -D CMAKE_PREFIX_PATH=${FOLDER}/prefix -D CMAKE_CXX_COMPILER=${COMPILER}
    -D CMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER})
run(${CMAKE_COMMAND} --build ${FOLDER}/build)
run(${FOLDER}/build/with_static ${SOURCE}/sample_data/brain_3mm.nrrd 1)
set(of_static "${said}")
run(${FOLDER}/build/with_shared ${SOURCE}/sample_data/brain_3mm.nrrd 1)
if(NOT said STREQUAL of_static OR NOT said MATCHES "1\\.00 mm  0\\.0[0-9]+ N")
  message(FATAL_ERROR "the two libraries say different things, or no force:\n${of_static}\n${said}")
endif()
