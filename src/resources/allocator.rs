//! What is asked of the program's allocator: to give back memory that is no longer in use. In a program with another allocator, nothing happens.

#![allow(unsafe_code)]

/// Memory that is given back waits so many milliseconds, for whoever takes some next, unless the allocator's variable in the environment says otherwise.
#[cfg(feature = "allocator")]
pub fn give_back_after(milliseconds: i32) {
    /// `mi_option_purge_delay` of version 2, which the bindings do not name.
    const PURGE_DELAY: libmimalloc_sys::mi_option_t = 15;
    if std::env::var_os("MIMALLOC_PURGE_DELAY").is_none() {
        // SAFETY: it sets a number of the allocator's own, and may be called at any time.
        unsafe { libmimalloc_sys::mi_option_set(PURGE_DELAY, milliseconds.into()) };
    }
}

/// Gives back what this thread has freed, now: however long ago it was, the allocator looks at its clock only when it is called.
pub fn give_back() {
    // SAFETY: it touches freed memory only, and may be called at any time.
    #[cfg(feature = "allocator")]
    unsafe {
        libmimalloc_sys::mi_collect(true)
    };
}
