//! The allocator of the roles' programs.

/// Faster than the system's allocator for messages, which one thread allocates and another frees.
#[cfg(not(feature = "count-allocations"))]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[cfg(feature = "count-allocations")]
#[global_allocator]
static ALLOCATOR: &stats_alloc::StatsAlloc<std::alloc::System> = &stats_alloc::INSTRUMENTED_SYSTEM;

/// Allocations of this process so far, in all threads; `None` unless built with the feature `count-allocations`.
pub fn allocations() -> Option<u64> {
    #[cfg(feature = "count-allocations")]
    return Some((ALLOCATOR.stats().allocations + ALLOCATOR.stats().reallocations) as u64);
    #[cfg(not(feature = "count-allocations"))]
    None
}
