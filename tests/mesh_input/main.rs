//! Mesh input from outside: every form that is read, every kind of file that is refused, and real meshes.

mod broken;
mod files;
mod gltf_compressed;
mod gltf_costs;
mod gltf_forms;
mod gltf_refused;
mod gltf_scene;
mod groups;
mod hostile_names;
mod joined;
mod make;
mod messages;
mod obj_forms;
mod off;
mod ply_forms;
mod ply_make;
mod ply_refused;
mod proportion;
mod shared;
mod stl_forms;
