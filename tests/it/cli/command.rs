//! A program as a stage: what it may do, how it may lie, and what dies with it.

#![allow(clippy::disallowed_methods, reason = "tests wait and measure")]

use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use crate::support::{cli::Ended, desk::Desk};
use serde_json::Value;

const HEAD: &str = "schema = 1\nname = \"programs\"\n[task]\nenv = \"planar\"\n";

impl Desk {
    fn write(&self, stages: &str) {
        fs::write(self.path("it.toml"), format!("{HEAD}{stages}")).unwrap();
    }

    /// Runs a pipeline with these stages.
    fn run(&self, stages: &str) -> Ended {
        self.write(stages);
        self.call(&["run", "it.toml", "--json", "--quiet"])
    }

    /// The text of an output of a node.
    fn output(&self, name: &str) -> String {
        fs::read_to_string(self.path("artifacts/runs/latest").join(name)).unwrap()
    }

    /// How many files lie below a folder of the store.
    fn count(&self, folder: &str) -> usize {
        fn below(path: &Path) -> usize {
            let items = fs::read_dir(path).into_iter().flatten().flatten();
            items.map(|item| if item.path().is_dir() { below(&item.path()) } else { 1 }).sum()
        }
        below(&self.path("artifacts").join(folder))
    }
}

/// A stage that runs a script of the shell; `{outputs.a}` is its output.
fn shell(script: &str, rest: &str) -> String {
    let script = serde_json::to_string(script).unwrap();
    format!(
        "[stages.it]\nkind = \"command\"\nargv = [\"sh\", \"-c\", {script}]\noutputs = {{ a = \"a.txt\" }}\n{rest}\n"
    )
}

fn number(ended: &Ended, name: &str) -> Value {
    assert!(ended.code.is_some_and(|code| code < 2), "{ended:?}");
    ended.json()[name].clone()
}

#[test]
fn a_program_gets_its_inputs_parameters_and_seed_and_runs_once() {
    let desk = Desk::new();
    let two = "[stages.one]\nkind = \"command\"\nargv = [\"sh\", \"-c\", \"echo one > {outputs.x}\"]\n\
               outputs = { x = \"below/x.txt\" }\n";
    let script = "cat {inputs.many}/0/below/x.txt {inputs.many}/1/a.txt > {outputs.a}; echo {params.word} {{}} {seed} \
                  >> {outputs.a}; echo \"$CARL_PARAMS\" >> {outputs.a}";
    let first = two.replace("stages.one", "stages.two").replace("below/x.txt", "a.txt").replace("echo one", "echo two");
    let stages = format!(
        "{two}{first}{}",
        shell(script, "inputs = { many = [\"one\", \"two\"] }\nparams = { word = \"w\", n = [1, 2] }")
    );
    let ended = desk.run(&stages);
    assert_eq!(number(&ended, "executed"), 3, "{ended:?}");
    let output = desk.output("it.a.txt");
    let lines: Vec<&str> = output.lines().collect();
    assert_eq!((lines[0], lines[1], lines[3]), ("one", "two", "{\"n\":[1,2],\"word\":\"w\"}"));
    let seed = lines[2].strip_prefix("w {} ").unwrap();
    assert!(seed.parse::<u32>().is_ok(), "{seed}");
    assert_eq!(number(&desk.run(&format!("# a comment\n{stages}")), "executed"), 0);
    assert_eq!(number(&desk.call(&["run", "it.toml", "--json", "--quiet", "-S", "seed=1"]), "executed"), 3);
    assert!(!desk.output("it.a.txt").contains(seed));
    assert_eq!(desk.count("tmp"), 0);
}

#[test]
fn an_edit_of_the_program_runs_it_again_and_a_replay_runs_the_old_one() {
    let desk = Desk::new();
    fs::create_dir(desk.path("code")).unwrap();
    fs::write(desk.path("code/it.sh"), "cat more.txt > $1").unwrap();
    fs::write(desk.path("more.txt"), "old").unwrap();
    let stage = "[stages.it]\nkind = \"command\"\nargv = [\"sh\", \"code/it.sh\", \"{outputs.a}\"]\n\
                 outputs = { a = \"a.txt\" }\nfiles = [\"code/it.sh\", \"more.txt\"]\n";
    assert_eq!(number(&desk.run(stage), "executed"), 1);
    assert_eq!(number(&desk.run(stage), "executed"), 0);
    fs::write(desk.path("more.txt"), "new").unwrap();
    let replayed = desk.call(&["replay", "latest"]);
    assert_eq!(replayed.code, Some(0), "{replayed:?}");
    let why = desk.call(&["why", "it.toml", "it"]);
    assert!(why.out.contains("found.files.more.txt"), "{}", why.out);
    assert_eq!(number(&desk.run(stage), "executed"), 1);
    assert_eq!(desk.output("it.a.txt"), "new");
    fs::remove_file(desk.path("more.txt")).unwrap();
    let ended = desk.run(stage);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.err.contains("`files.1` cannot be read: No such file or directory"), "{}", ended.err);
}

#[test]
fn a_program_that_lies_is_named_and_publishes_nothing() {
    let good = "echo x > {outputs.a}";
    let cases = [
        ("true", "", "the program ended with exit status 0 but did not write the output `a` (`a.txt`)"),
        ("echo x > {outputs.a}; echo x > {outputs.a}2", "", "wrote `a.txt2`, which `outputs` does not declare"),
        ("echo x > {outputs.a}; (sleep 60; echo late >> {outputs.a}) &", "", "the program ended but left process"),
        ("echo x > {outputs.a}; setsid -f sh -c 'sleep 60; echo late >> {outputs.a}'", "", "but left process"),
        ("ln -s /etc/passwd {outputs.a}", "", "the output `a.txt` is a symbolic link"),
        ("mkfifo {outputs.a}", "", "the output `a.txt` is not a file but a pipe"),
        ("echo x > b; ln b {outputs.a}", "", "the output `a.txt` has a second name"),
        ("echo x > {outputs.a}; echo x > \"$(printf '{outputs.a}\\377')\"", "", "whose name is not printable UTF-8"),
        ("echo oh; echo no >&2; exit 7", "", "the program ended with exit status 7; its last words:\n  | no"),
        ("kill -9 $$", "", "the program was killed by signal 9 without a word"),
        ("sleep 60", "timeout = 1", "the program took longer than its `timeout` of 1 s"),
        ("trap '' TERM; sleep 60; sleep 60", "timeout = 1", "the program took longer than its `timeout` of 1 s"),
        (good, "gives = \"transitions\"", "what the program wrote is no transitions"),
        (good, "argv = [\"no-such-program\"]", "there is no program `no-such-program` in `PATH`"),
        ("echo x > {outputs.a}; echo '{{}}' >&3", "", "line 1 of its events is no event"),
        ("echo '{{\"metric\": \"m\", \"value\": NaN}}' >&3; sleep 60", "", "line 1 of its events is no event"),
    ];
    for (script, rest, error) in cases {
        let desk = Desk::new();
        let mut stage = shell(script, rest);
        if rest.starts_with("argv") {
            let own = stage.lines().filter(|line| !line.starts_with("argv = [\"sh\"")).collect::<Vec<_>>().join("\n");
            stage = own;
        }
        let ended = desk.run(&stage);
        assert_eq!(ended.code, Some(1), "{script}: {ended:?}");
        assert!(ended.err.contains(error), "{script}: {}", ended.err);
        assert_eq!((desk.count("keys"), desk.count("objects"), desk.count("tmp")), (0, 0, 0), "{script}");
    }
}

#[test]
fn a_program_that_writes_into_its_inputs_is_refused_and_harms_no_result() {
    for change in
        ["echo more >> {inputs.x}/x.txt", "chmod 777 {inputs.x}/x.txt", "touch {inputs.x}/y", "rm {inputs.x}/x.txt"]
    {
        let desk = Desk::new();
        let one = "[stages.one]\nkind = \"command\"\nargv = [\"sh\", \"-c\", \"echo one > {outputs.x}\"]\n\
                   outputs = { x = \"x.txt\" }\n";
        let ended = desk
            .run(&format!("{one}{}", shell(&format!("{change}; echo x > {{outputs.a}}"), "inputs = { x = \"one\" }")));
        assert!(ended.err.contains("the program wrote into its inputs, at `x"), "{change}: {}", ended.err);
        assert_eq!((ended.code, desk.count("keys")), (Some(1), 1), "{change}");
        assert_eq!(desk.call(&["verify"]).code, Some(0), "{change}");
    }
}

#[test]
fn a_typed_output_goes_to_our_stages_and_tables() {
    let desk = Desk::new();
    let evaluation = r#"{"percent_goal": 12.5, "policy_alone": 12.5, "percent_goal_t": 12.5, "share_of_ceiling": null,
        "unstick": "off", "radius": 2.0, "horizon": 1, "episodes": [{"goal": 0, "percent_goal": 12.5, "policy_alone": 12.5, "path": []}]}"#;
    fs::write(desk.path("e.json"), evaluation).unwrap();
    let stage = "[stages.it]\nkind = \"command\"\nargv = [\"cp\", \"e.json\", \"{outputs.e}\"]\nfiles = [\"e.json\"]\n\
                 outputs = { e = \"evaluation.json\" }\ngives = \"evaluation\"\n\
                 [stages.sum]\nkind = \"summarize\"\ninputs = { evaluations = [\"it\"] }\n";
    let ended = desk.run(stage);
    assert_eq!(number(&ended, "executed"), 2, "{ended:?}");
    let table = desk.call(&["table", "latest", "--long"]);
    assert!(table.out.contains("12.5"), "{table:?}");
    // A port of another type refuses it before anything runs.
    let wrong =
        desk.run(&format!("{stage}[stages.learn]\nkind = \"train_lce\"\ninputs = {{ transitions = \"it\" }}\n"));
    assert!(wrong.err.contains("takes transitions, but `it` gives evaluation"), "{}", wrong.err);
}

#[test]
fn mistakes_of_a_command_are_shown_at_their_places() {
    let desk = Desk::new();
    let cases = [
        ("argv = []\noutputs = {}", "7:8", "`argv` takes 1 values"),
        ("argv = [\"a\", \"{inputs.no}\"]\noutputs = {}", "7:14", "names the input `no`"),
        ("argv = [\"a\", \"{outputs.no}\"]\noutputs = {}", "7:14", "names the output `no`"),
        ("argv = [\"a\", \"{params.no}\"]\noutputs = {}", "7:14", "names the parameter `no`"),
        ("argv = [\"a\", \"{sed}\"]\noutputs = {}", "7:14", "has an unknown place `{sed}`"),
        ("argv = [\"a\"]\noutputs = { x = \"../x\" }", "8:17", "is no path below the folder of outputs"),
        ("argv = [\"a\"]\noutputs = { x = \"/x\" }", "8:17", "is no path below the folder of outputs"),
        ("argv = [\"a\"]\noutputs = {}\nfiles = [\"no.py\"]", "9:10", "cannot be read: No such file or directory"),
        ("argv = [\"a\"]\noutputs = {}\nfiles = [\"/etc/passwd\"]", "9:10", "is no path from the folder"),
        ("argv = [\"a\"]\noutputs = {}\nenv = [\"NOT_SET_ANYWHERE\"]", "9:8", "is not set here"),
        ("argv = [\"a\"]\noutputs = {}\nenv = [\"CARL_EVENTS=4\"]", "9:8", "carl-pipe sets itself"),
        ("argv = [\"a\"]\noutputs = {}\ngives = \"transition\"", "9:9", "cannot be `transition`"),
        ("outputs = {}", "5:9", "`command` needs `argv`"),
        ("argv = [\"no-python\"]\noutputs = {}\npackages = [\"numpy\"]", "9:12", "cannot be looked up: `no-python`"),
    ];
    for (text, place, message) in cases {
        let ended = desk.run(&format!("[stages.it]\nkind = \"command\"\n{text}\n"));
        assert_eq!(ended.code, Some(3), "{text}: {ended:?}");
        assert!(
            ended.err.contains(message) && ended.err.contains(&format!("it.toml:{place}")),
            "{text}: {}",
            ended.err
        );
    }
}

#[test]
fn only_allowed_variables_reach_a_program_and_their_values_are_in_the_key() {
    let desk = Desk::new();
    desk.write(&shell("env > {outputs.a}", "env = [\"ALLOWED\", \"SET=here\"]"));
    let run = |allowed: &str| {
        let mut command = desk.command(&["run", "it.toml", "--json", "--quiet"]);
        let ended = command.env("ALLOWED", allowed).env("SECRET", "s").output().unwrap();
        number(&Ended::of(ended), "executed")
    };
    assert_eq!((run("1"), run("1"), run("2")), (1.into(), 0.into(), 1.into()));
    let output = desk.output("it.a.txt");
    let has = |line: &str| output.lines().any(|other| other == line);
    assert!(has("ALLOWED=2") && has("SET=here") && has("CARL_EVENTS=3") && !output.contains("SECRET"), "{output}");
}

#[test]
fn a_failed_program_starts_again_as_often_as_it_may() {
    let desk = Desk::new();
    let script =
        format!("echo x >> {0}; test $(wc -l < {0}) = 3 && echo done > {{outputs.a}}", desk.path("count").display());
    let ended = desk.run(&shell(&script, "retries = 1"));
    assert!(ended.err.contains("the program ended with exit status 1"), "{ended:?}");
    fs::remove_file(desk.path("count")).unwrap();
    assert_eq!(number(&desk.run(&shell(&script, "retries = 2")), "failed"), 0);
    let events = desk.output("events.jsonl");
    assert!(events.contains("attempt 2 of 3 failed: the program ended with exit status 1"), "{events}");
}

#[test]
fn events_become_metrics_and_curves() {
    let desk = Desk::new();
    let script = "for n in 1 2 3; do echo \"{{\\\"scalar\\\": \\\"loss\\\", \\\"value\\\": 0.$n, \\\"step\\\": $n}}\" >&3; done; \
                  echo '{{\"metric\": \"score\", \"value\": 4.5}}' >&3; echo '{{\"progress\": 1, \"of\": 1}}' >&3; \
                  echo '{{\"say\": \"well\"}}' >&3; echo printed; echo x > {outputs.a}";
    assert_eq!(number(&desk.run(&shell(script, "")), "executed"), 1);
    let manifest: Value = serde_json::from_str(&desk.output("manifest.json")).unwrap();
    assert_eq!(manifest["nodes"][0]["figures"]["score"], 4.5);
    assert!(desk.output("events.jsonl").contains("\"well\""));
    let recording = fs::read(desk.path("artifacts/runs/latest/it.mcap")).unwrap();
    let has = |word: &str| recording.windows(word.len()).any(|window| window == word.as_bytes());
    assert!(has("/program/loss") && has("/log"));
    assert_eq!(desk.call(&["replay", "latest"]).code, Some(0));
}

/// Whether a process lives.
fn lives(pid: &str) -> bool {
    let stat = fs::read_to_string(format!("/proc/{}/stat", pid.trim())).unwrap_or_default();
    stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with(['Z', 'X']))
}

fn wait_for(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(20), "{what} takes too long");
        sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_program_never_outlives_a_killed_run_and_the_next_run_works() {
    let desk = Desk::new();
    let file = |name: &str| desk.path(name).display().to_string();
    // A child in the group, a child that left the group, and the program itself.
    let script = format!(
        "test -e {go} && echo x > {{outputs.a}} && exit; sleep 300 & echo $! > {one}; setsid sleep 301 & \
         while ! pgrep -f 'sleep 301' > {two}; do :; done; echo half > {{outputs.a}}; echo $$ > {three}; sleep 302",
        go = file("go"),
        one = file("1"),
        two = file("2"),
        three = file("3")
    );
    desk.write(&shell(&script, ""));
    let mut runner = desk.command(&["run", "it.toml", "--progress", "none"]).stderr(Stdio::null()).spawn().unwrap();
    wait_for("the program", || fs::read_to_string(desk.path("3")).is_ok_and(|pid| pid.ends_with('\n')));
    let read = |name: &str| fs::read_to_string(desk.path(name)).unwrap();
    let pids: Vec<String> = [read("1"), read("3")].into_iter().chain(read("2").lines().map(str::to_owned)).collect();
    assert!(pids.iter().all(|pid| lives(pid)), "{pids:?}");
    runner.kill().unwrap();
    runner.wait().unwrap();
    let killed = Instant::now();
    wait_for("the death of the program", || !pids.iter().any(|pid| lives(pid)));
    assert!(killed.elapsed() < Duration::from_secs(1), "{:?}", killed.elapsed());
    assert_eq!((desk.count("keys"), desk.count("objects")), (0, 0));
    fs::write(desk.path("go"), "").unwrap();
    let ended = desk.call(&["run", "it.toml", "--json", "--quiet"]);
    assert_eq!((number(&ended, "executed"), desk.count("tmp")), (1.into(), 0), "{ended:?}");
    assert_eq!(desk.output("it.a.txt"), "x\n");
}

#[test]
fn an_interrupt_stops_the_program() {
    let desk = Desk::new();
    let pid = desk.path("pid");
    desk.write(&shell(&format!("echo $$ > {}; sleep 300; true", pid.display()), ""));
    let mut runner = desk.command(&["run", "it.toml", "--progress", "none"]).stderr(Stdio::null()).spawn().unwrap();
    wait_for("the program", || fs::read_to_string(&pid).is_ok_and(|pid| pid.ends_with('\n')));
    let own = rustix::process::Pid::from_child(&runner);
    rustix::process::kill_process(own, crate::support::cli::stop_signal()).unwrap();
    assert_eq!(runner.wait().unwrap().code(), Some(130));
    assert!(!lives(&fs::read_to_string(&pid).unwrap()));
    assert_eq!((desk.count("keys"), desk.count("tmp")), (0, 0));
}

/// `OUTPUT_MIB` is the size of the output.
#[test]
fn a_large_output_is_never_in_memory() {
    let desk = Desk::new();
    let mib: u64 = std::env::var("OUTPUT_MIB").ok().and_then(|text| text.parse().ok()).unwrap_or(256);
    // A sparse file has as many bytes as any other for those who read it.
    let big = format!(
        "[stages.big]\nkind = \"command\"\nargv = [\"truncate\", \"-s\", \"{mib}M\", \"{{outputs.b}}\"]\n\
         outputs = {{ b = \"b.bin\" }}\n"
    );
    let look = "stat -c %s {inputs.big}/b.bin > {outputs.a}; grep VmHWM /proc/$PPID/status >> {outputs.a}";
    let start = Instant::now();
    let ended = desk.run(&format!("{big}{}", shell(look, "inputs = { big = \"big\" }")));
    assert_eq!(number(&ended, "executed"), 2, "{ended:?}");
    let output = desk.output("it.a.txt");
    let words: Vec<&str> = output.split_whitespace().collect();
    let (size, peak_kib): (u64, u64) = (words[0].parse().unwrap(), words[2].parse().unwrap());
    assert_eq!(size, mib << 20);
    assert!(peak_kib < 200 << 10, "{peak_kib} KiB");
    eprintln!("peak {} MiB, {:.1} s", peak_kib >> 10, start.elapsed().as_secs_f64());
}

#[test]
fn the_example_runs() {
    let desk = Desk::new();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/command/pipeline.toml");
    if Command::new("python3").arg("--version").output().is_err() {
        println!("no python3: not tested");
        return;
    }
    let ended = desk.call(&["run", example.to_str().unwrap(), "--json", "--quiet"]);
    assert_eq!(number(&ended, "executed"), 3, "{ended:?}");
}
