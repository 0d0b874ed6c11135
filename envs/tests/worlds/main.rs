//! The worlds from outside: against the rules worked out by hand, against chance, and against the reference.

mod battle_maps;
mod battle_policies;
mod battle_spoilt;
mod battle_traces;
mod conformance;
mod foraging_starts;
mod foraging_steps;
mod golden;
mod particles_opponents;
mod particles_padding;
mod particles_starts;
mod particles_steps;
mod particles_traces;
mod registered_ids;
mod spoilt_traces;
mod traces;
mod uniform;
mod warehouse_spoilt;
mod warehouse_starts;
mod warehouse_steps;
