# Who may include whom: io <- preprocess <- solver (its plain headers only) <- apps; and within apps
# run <- studies <- commands. Run as
#   cmake -D SOURCE=<root> -P include_direction.cmake
set(forbidden_io "^(preprocess|solver|apps)/")
set(forbidden_preprocess "^(solver|apps)/")
set(forbidden_solver "^(apps/|itk|vtk|CGAL/|nanoflann|fmt/|spdlog/|toml|nlohmann/|CLI/)")
# The solver is handed a Model and speaks in errors: nothing else of the other folders reaches it, but for the macro
# that both clone their hot loops with.
set(allowed_solver "^(solver/.*|preprocess/(model|scheme|clones)\\.hpp|io/(error|stop|types)\\.hpp)$")
# What computes prints nothing: the log and the command line are known to the commands alone.
set(forbidden_apps/run "^(apps/(studies|commands|ending|examples)|spdlog/|CLI/)")
set(forbidden_apps/studies "^(apps/(commands|examples)/|spdlog/|CLI/)")
set(forbidden_apps/commands "^apps/examples/")
set(forbidden_apps/examples "^apps/")
set(forbidden_apps/python "^(apps/(studies|commands|examples)/|spdlog/|CLI/)")

set(wrong "")
foreach(folder io preprocess solver apps/run apps/studies apps/commands apps/examples apps/python)
  file(GLOB_RECURSE files ${SOURCE}/${folder}/*.cpp ${SOURCE}/${folder}/*.hpp)
  if(NOT files)
    list(APPEND wrong "no sources in ${SOURCE}/${folder}")
  endif()
  foreach(file IN LISTS files)
    file(STRINGS ${file} lines REGEX "^[ \t]*#[ \t]*include")
    foreach(line IN LISTS lines)
      string(REGEX REPLACE "^[^<\"]*[<\"]([^>\"]*)[>\"].*$" "\\1" header "${line}")
      set(bad FALSE)
      if(header MATCHES "${forbidden_${folder}}")
        set(bad TRUE)
      elseif(folder STREQUAL "solver" AND header MATCHES "^(io|preprocess|solver)/"
             AND NOT header MATCHES "${allowed_solver}")
        set(bad TRUE)
      endif()
      if(bad)
        file(RELATIVE_PATH name ${SOURCE} ${file})
        list(APPEND wrong "${name} includes ${header}")
      endif()
    endforeach()
  endforeach()
endforeach()
if(wrong)
  list(JOIN wrong "\n  " wrong)
  message(FATAL_ERROR "Includes against the direction of the folders:\n  ${wrong}")
endif()
