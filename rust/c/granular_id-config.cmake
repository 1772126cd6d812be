# find_package(granular_id): the targets granular_id::granular_id (shared) and granular_id::static, for C and C++17.
get_filename_component(_granular_id "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
foreach(_kind IN ITEMS SHARED STATIC)
  string(REPLACE SHARED granular_id _target ${_kind})
  string(REPLACE STATIC static _target ${_target})
  if(TARGET granular_id::${_target})
    continue()
  endif()
  add_library(granular_id::${_target} ${_kind} IMPORTED)
  set_target_properties(granular_id::${_target} PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES "${_granular_id}/include"
    IMPORTED_LOCATION "${_granular_id}/lib/${CMAKE_${_kind}_LIBRARY_PREFIX}granular_id_c${CMAKE_${_kind}_LIBRARY_SUFFIX}")
endforeach()
set_target_properties(granular_id::granular_id PROPERTIES IMPORTED_NO_SONAME TRUE)
set_target_properties(granular_id::static PROPERTIES INTERFACE_LINK_LIBRARIES "pthread;dl;m")
unset(_granular_id)
