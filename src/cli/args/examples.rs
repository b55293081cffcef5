//! Examples below the help of each command.

use super::shared;

const RECONSTRUCT: &str = "\
Examples:
  asra-stream scan.ply                                    an object: writes scan.mesh.ply
  asra-stream 'scans/*.las' --max-memory 2G -o all.glb    many files as one cloud, in at most 2 GB
  asra-stream tile.laz --surface terrain --cell-size auto -o tile.ply
                                                          ground, buildings and trees, seen from above
  asra-stream scan.e57 --fit sphere --cell-size 5mm       a noisy scan
  asra-stream plan scan.ply --max-memory 2G               what it would take: no mesh is made";

pub const PLAN: &str = "\
Examples:
  asra-stream plan scans/ --max-memory 4G     does it fit, and how many triangles will it have?
  asra-stream plan city.laz --tile 100m --json
  asra-stream plan tiles/ -o city.ply --work /shared/city --processes 16
                                              a run for 16 processes, as tasks in a folder that all can reach";

pub const TASKS: &str = "\
Examples:
  asra-stream tasks /shared/city              what is done, what can be done, what has to wait
  asra-stream tasks /shared/city --ready --json";

pub const WORK: &str = "\
Examples:
  asra-stream work /shared/city --any         in each process, on any machine: does what can be done, until all is
  asra-stream work /shared/city bucket/0 bucket/1";

pub const INFO: &str = "\
Examples:
  asra-stream info scan.bin     which layout, how many points, how densely they lie
  asra-stream info tiles/*.laz --json";

pub const CHECK: &str = "\
Examples:
  asra-stream check mesh.ply                         exit code 4 if it is not sound
  asra-stream check terrain.ply --open --report check.json";

pub const COMPARE: &str = "\
Examples:
  asra-stream compare mesh.ply scan.ply              distances both ways
  asra-stream compare mesh.ply true.stl --heatmap heat.ply --heatmap-max 1cm";

pub const DENSIFY: &str = "\
Examples:
  asra-stream densify mesh.ply scan.ply -o dense.ply";

pub const SIMPLIFY: &str = "\
Examples:
  asra-stream simplify mesh.ply 0.25c -o light.ply   the surface moves by a quarter of a cell at most
  asra-stream simplify scan.stl 0.1mm -o light.stl
  asra-stream simplify mesh.ply --max-triangles 500k -o light.glb";

pub const TILESET: &str = "\
Examples:
  asra-stream tileset mesh.ply -o city/tileset.json  levels of detail, for viewers of 3D Tiles";

pub const VIEW: &str = "\
Examples:
  asra-stream view city/tileset.json                 prints an address, and opens a browser there
  asra-stream view scan.mesh.ply --port 8080         the same port each time, as for an ssh tunnel";

pub const RENDER: &str = "\
Examples:
  asra-stream render mesh.ply                        six views beside each other: writes mesh.png
  asra-stream render mesh.ply --views front,top --size 1600x800 -o views.png";

pub const GENERATE: &str = "\
Examples:
  asra-stream generate sphere 2M -o sphere.bin";

pub const COMPLETIONS: &str = "\
Examples:
  asra-stream completions bash > ~/.local/share/bash-completion/completions/asra-stream
  asra-stream completions zsh > ~/.zfunc/_asra-stream
  asra-stream completions fish > ~/.config/fish/completions/asra-stream.fish";

pub const MAN: &str = "\
Examples:
  asra-stream man > asra-stream.1
  asra-stream man check > asra-stream-check.1";

/// The text below the command's own help: examples, and the table of exit codes in short.
pub fn of_the_command() -> String {
    format!("{RECONSTRUCT}\n\n{}", shared::exit_codes())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::super::Arguments;
    use super::*;

    #[test]
    fn examples_are_what_the_command_takes() {
        let all = [
            RECONSTRUCT,
            PLAN,
            INFO,
            CHECK,
            COMPARE,
            DENSIFY,
            SIMPLIFY,
            TILESET,
            VIEW,
            RENDER,
            GENERATE,
            COMPLETIONS,
            MAN,
        ];
        for text in all {
            let commands: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("  asra-stream ")).collect();
            assert!(!commands.is_empty(), "{text}");
            for command in commands {
                // What follows is what it means, or where the shell puts it.
                let typed = command.split("  ").next().unwrap_or_default().split(" > ").next().unwrap_or_default();
                let words = typed.split_whitespace().map(|word| word.trim_matches('\''));
                Arguments::try_parse_from(["asra-stream"].into_iter().chain(words))
                    .unwrap_or_else(|e| panic!("{command}: {e}"));
            }
        }
    }
}
