# Tests the script `compare` on small files: ratios, their order and mean, and refusals. Run as
#   cmake -D COMPARE=<script> -D FOLDER=<scratch> -P compare_test.cmake
file(MAKE_DIRECTORY ${FOLDER})
file(WRITE ${FOLDER}/old.csv "# machine: A\n# version: 1\nbenchmark,time_us,spread\na/1,100,0.01\nb/1,50,0\nold/1,7,0\n")
file(WRITE ${FOLDER}/new.csv "# machine: A\n# version: 2\nbenchmark,time_us,spread\nb/1,25,0\na/1,2e2,0\nnew/1,7,0\n")
file(WRITE ${FOLDER}/other.csv "benchmark,time_us\nc/1,1\n")
file(WRITE ${FOLDER}/no_number.csv "benchmark,time_us\na/1,fast\n")
file(WRITE ${FOLDER}/no_header.csv "a/1,100\n")
file(WRITE ${FOLDER}/empty.csv "")

execute_process(COMMAND sh ${COMPARE} ${FOLDER}/old.csv ${FOLDER}/new.csv
  OUTPUT_VARIABLE said ERROR_VARIABLE complaint RESULT_VARIABLE code)
set(expected "0\\.500 +50 +25 +b/1\n +2\\.000 +100 +200 +a/1\n +1\\.000 +geometric mean of 2\n")
string(APPEND expected "only in the old: +old/1\nonly in the new: +new/1\n")
if(NOT code EQUAL 0 OR NOT said MATCHES "${expected}")
  message(FATAL_ERROR "two good files: code ${code}\n${said}${complaint}")
endif()

foreach(refused IN ITEMS "other.csv|no benchmark in common" "no_number.csv|no_number.csv:2: \"fast\" is no time"
    "no_header.csv|no line of column names" "empty.csv|no results" "missing.csv|cannot be read")
  string(REGEX MATCH "^[^|]*" name "${refused}")
  string(REGEX REPLACE "^[^|]*.(.*)$" "\\1" expected "${refused}")
  foreach(files IN ITEMS "${FOLDER}/old.csv|${FOLDER}/${name}" "${FOLDER}/${name}|${FOLDER}/old.csv")
    string(REPLACE "|" ";" files "${files}")
    execute_process(COMMAND sh ${COMPARE} ${files}
      OUTPUT_VARIABLE said ERROR_VARIABLE complaint RESULT_VARIABLE code)
    string(FIND "${complaint}" "${expected}" at)
    if(code EQUAL 0 OR at LESS 0)
      message(FATAL_ERROR "${files}: code ${code}\n${said}${complaint}")
    endif()
  endforeach()
endforeach()
