//! The allocator of every program that is a role.

/// Faster than the system's for messages, which one thread allocates and another frees.
#[cfg(not(feature = "count-allocations"))]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[cfg(feature = "count-allocations")]
#[global_allocator]
static ALLOCATOR: &stats_alloc::StatsAlloc<std::alloc::System> = &stats_alloc::INSTRUMENTED_SYSTEM;

/// How often this process has allocated memory so far, in all threads; `None` unless it was built with the feature
/// `count-allocations`.
pub fn allocations() -> Option<u64> {
    #[cfg(feature = "count-allocations")]
    return Some((ALLOCATOR.stats().allocations + ALLOCATOR.stats().reallocations) as u64);
    #[cfg(not(feature = "count-allocations"))]
    None
}
