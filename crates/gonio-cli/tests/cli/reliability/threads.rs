//! Tests that results do not depend on the number of threads.

use super::{Job, job, same, written};

fn compare(job: &Job) {
    let bench = job.bench();
    // The undisturbed run had two threads.
    let whole = &job.undisturbed().files;
    for threads in [1, 7] {
        bench.run(&format!("{} --threads {threads}", job.to("out"))).succeeds();
        same(&written(&bench, &job.output("out")), whole, &format!("{} with {threads} threads", job.name));
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    compare(job("infer"));
}

each_job!(one_two_and_seven_threads: compare);
