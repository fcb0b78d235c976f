//! Structs whose first field is their size, across versions of the library.

use std::mem::MaybeUninit;
use std::ptr;

use crate::status::{Fault, SVBRDF_UNSUPPORTED};

/// Largest size taken for meant.
const MAX_SIZE: usize = 4096;

/// A struct of the header.
///
/// # Safety
/// `repr(C)`, begins with `size: usize`, and every bit pattern of the other fields is a value:
/// numbers, raw pointers, nullable function pointers.
pub(crate) unsafe trait Versioned: Copy {
    /// Its name in the header.
    const NAME: &'static str;
    /// Its size in the first release.
    const FIRST_SIZE: usize;
    /// The values that `_init` writes, with any `size`.
    fn defaults() -> Self;
}

/// Implements [`Versioned`] with the size in the first release: all of the struct, until a field is
/// added; from then on `offset_of!(the_struct, the_added_field)`.
macro_rules! versioned {
    ($type:ident, $first_size:expr) => {
        const _: () = assert!(std::mem::offset_of!($type, size) == 0);
        // SAFETY: the struct stands beside this line: repr(C), its size first, then numbers,
        // raw pointers and nullable function pointers only.
        unsafe impl $crate::versioned::Versioned for $type {
            const NAME: &'static str = stringify!($type);
            const FIRST_SIZE: usize = $first_size;
            fn defaults() -> Self {
                Self::default()
            }
        }
    };
}
pub(crate) use versioned;

/// Implements `Default`: `size`, the fields named, and 0, NULL or nothing for the others.
macro_rules! defaults {
    ($type:ident { $($field:ident: $value:expr),* $(,)? }) => {
        impl Default for $type {
            fn default() -> Self {
                Self { $($field: $value,)* ..$crate::versioned::zeroed() }
            }
        }
    };
}
pub(crate) use defaults;

/// A struct whose bytes are 0 but for its size.
pub(crate) fn zeroed<T: Versioned>() -> T {
    let mut value = MaybeUninit::<T>::zeroed();
    // SAFETY: `T` begins with its size, and all bits of the others are a value.
    unsafe {
        value.as_mut_ptr().cast::<usize>().write(size_of::<T>());
        value.assume_init()
    }
}

fn check_size<T: Versioned>(size: usize) -> Result<(), Fault> {
    if (T::FIRST_SIZE..=MAX_SIZE).contains(&size) {
        return Ok(());
    }
    let (name, first) = (T::NAME, T::FIRST_SIZE);
    Err(Fault::argument(format!(
        "{name}.size: {size} given, at least {first} expected; call {name}_init() first"
    )))
}

fn check_pointer<T: Versioned>(pointer: *const T) -> Result<(), Fault> {
    let name = T::NAME;
    if pointer.is_null() {
        return Err(Fault::argument(format!("{name}: NULL given")));
    }
    if !pointer.is_aligned() {
        return Err(Fault::argument(format!("{name}: the address is not aligned")));
    }
    Ok(())
}

/// Copies a caller's struct of any version. Fields that it does not have keep their defaults.
///
/// # Safety
/// NULL, or as many readable bytes as its `size` field says.
pub(crate) unsafe fn read<T: Versioned>(pointer: *const T) -> Result<T, Fault> {
    check_pointer(pointer)?;
    // SAFETY: the size is the first field, and the caller vouches for it.
    let size = unsafe { pointer.cast::<usize>().read() };
    check_size::<T>(size)?;
    let mut value = T::defaults();
    let known = size.min(size_of::<T>());
    // SAFETY: both have `known` bytes, and any bytes are a value of `T`.
    unsafe { ptr::copy_nonoverlapping(pointer.cast::<u8>(), (&raw mut value).cast(), known) };
    for i in known..size {
        // SAFETY: inside the caller's struct.
        if unsafe { pointer.cast::<u8>().add(i).read() } != 0 {
            let message = format!("{}: a field is set that this version does not know", T::NAME);
            return Err(Fault::new(SVBRDF_UNSUPPORTED, message));
        }
    }
    Ok(value)
}

/// As [`read`]; the defaults for NULL.
///
/// # Safety
/// As [`read`].
pub(crate) unsafe fn read_or_default<T: Versioned>(pointer: *const T) -> Result<T, Fault> {
    if pointer.is_null() {
        return Ok(T::defaults());
    }
    // SAFETY: as the caller vouches.
    unsafe { read(pointer) }
}

/// The size a caller's result struct says it has; `None` without a struct.
///
/// # Safety
/// As [`read`].
pub(crate) unsafe fn result_size<T: Versioned>(pointer: *const T) -> Result<Option<usize>, Fault> {
    if pointer.is_null() {
        return Ok(None);
    }
    check_pointer(pointer)?;
    // SAFETY: the size is the first field, and the caller vouches for it.
    let size = unsafe { pointer.cast::<usize>().read() };
    check_size::<T>(size)?;
    Ok(Some(size))
}

/// The same where there has to be a struct.
///
/// # Safety
/// As [`read`].
pub(crate) unsafe fn needed_size<T: Versioned>(
    name: &str,
    pointer: *const T,
) -> Result<usize, Fault> {
    // SAFETY: as the caller vouches.
    let size = unsafe { result_size(pointer) }?;
    size.ok_or_else(|| Fault::argument(format!("{name}: NULL given")))
}

/// Writes a result as far as the caller's struct reaches; its `size` stays.
///
/// # Safety
/// `size` writable bytes at `pointer`, found by [`result_size`].
pub(crate) unsafe fn write<T: Versioned>(pointer: *mut T, size: usize, value: T) {
    let skip = size_of::<usize>();
    let known = size.min(size_of::<T>());
    let from = (&raw const value).cast::<u8>();
    // SAFETY: both have `known` bytes, the size among them.
    unsafe {
        ptr::copy_nonoverlapping(from.add(skip), pointer.cast::<u8>().add(skip), known - skip)
    };
}

/// Fills a caller's struct with defaults: all of `size` bytes are written, none beyond.
///
/// # Safety
/// NULL, or `size` writable bytes.
pub(crate) unsafe fn init<T: Versioned>(pointer: *mut T, size: usize) -> Result<(), Fault> {
    check_pointer(pointer)?;
    check_size::<T>(size)?;
    // SAFETY: the caller vouches for `size` bytes; `write` stays inside them.
    unsafe {
        pointer.cast::<u8>().write_bytes(0, size);
        pointer.cast::<usize>().write(size);
        write(pointer, size, T::defaults());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[repr(C)]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct thing {
        size: usize,
        a: u64,
        b: u64,
    }
    defaults!(thing { a: 1, b: 2 });
    versioned!(thing, 16);

    #[test]
    fn older_and_newer_callers_are_understood() {
        let mut memory = [u64::MAX; 5];
        let pointer = memory.as_mut_ptr().cast::<thing>();
        // SAFETY: five words are there, and no size beyond 40 bytes is given.
        unsafe {
            // An older caller: its struct ends before `b`.
            init(pointer, 16).unwrap();
            assert_eq!(memory, [16, 1, u64::MAX, u64::MAX, u64::MAX]);
            memory[1] = 9;
            let pointer = memory.as_mut_ptr().cast::<thing>();
            assert_eq!(read(pointer).unwrap(), thing { size: 16, a: 9, b: 2 });
            write(pointer, 16, thing { size: 0, a: 5, b: 6 });
            assert_eq!(memory, [16, 5, u64::MAX, u64::MAX, u64::MAX]);
            // A newer caller: two fields more.
            let pointer = memory.as_mut_ptr().cast::<thing>();
            init(pointer, 40).unwrap();
            assert_eq!(memory, [40, 1, 2, 0, 0]);
            assert!(read(memory.as_ptr().cast::<thing>()).is_ok());
            memory[4] = 1;
            let fault = read(memory.as_ptr().cast::<thing>()).unwrap_err();
            assert_eq!(fault.status, SVBRDF_UNSUPPORTED);
            for size in [0, 8, 15, MAX_SIZE + 1, usize::MAX] {
                memory[0] = size as u64;
                let pointer = memory.as_mut_ptr().cast::<thing>();
                assert!(read(pointer).is_err() && result_size(pointer).is_err());
                assert!(init(pointer, size).is_err());
            }
            assert!(read(ptr::null::<thing>()).is_err());
            let crooked = memory.as_ptr().cast::<u8>().add(1).cast::<thing>();
            assert!(read(crooked).is_err());
        }
    }
}
