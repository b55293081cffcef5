//! What decides bytes is computed by the program itself, not by whatever C library a machine has.

#![allow(clippy::disallowed_methods)]

use std::path::Path;

/// Functions that the standard library takes from the C library, whose last bit differs from one to the next.
const FROM_OUTSIDE: [&str; 22] = [
    "sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "exp2", "exp_m1",
    "ln", "ln_1p", "log", "log2", "log10", "powf", "cbrt", "hypot",
];

fn scan(folder: &Path, found: &mut Vec<String>) {
    for entry in folder.read_dir().unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if path.ends_with("tests") {
                continue;
            }
            scan(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") && path.file_stem().is_some_and(|stem| stem != "tests") {
            let text = std::fs::read_to_string(&path).unwrap();
            // Tests stand at the end.
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
            for (number, line) in code.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
                for name in FROM_OUTSIDE {
                    if line.contains(&format!(".{name}(")) || line.contains(&format!("f64::{name}")) {
                        found.push(format!("{}:{}: {name}", path.display(), number + 1));
                    }
                }
            }
        }
    }
}

#[test]
fn no_function_of_the_c_library_decides_a_byte() {
    let mut found = Vec::new();
    scan(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut found);
    assert!(found.is_empty(), "use the crate libm: {found:#?}");
}
